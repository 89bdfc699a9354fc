# SPDX-License-Identifier: MIT
"""Ways to find an object's pose from its segment alone.

Each is given the same points with normals, and 2,000 points of the model with normals
or, if it needs a surface, its mesh. What can be made of a model once and for all is
made before the clock starts, for all alike.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from benchmarks.peers.cases import Case
from benchmarks.peers.installed import installed
from benchmarks.peers.refinement import Refiner, best_peer, ours
from physim_drake.hypotheses.generation import generate_hypotheses
from physim_drake.hypotheses.pairs import pair_index
from physim_drake.objects.model import ObjectModel
from physim_drake.poses import Array, inverse
from physim_drake.registration.registration_model import registration_model

MODEL_POINTS = 2000
_VOXEL = 0.005  # m, and the other sizes of Open3D's tutorial are multiples of it


class Registration(Protocol):
    """A method of registration.

    Attributes:
        name: name of the method.
        refiner: method that refines its pose.
        candidates: slice of its poses that a search would choose from.
    """

    name: str
    refiner: Refiner
    candidates: slice

    def prepare(self, model: ObjectModel) -> Any:
        """Makes what it needs of a model."""

    def propose(self, prepared: Any, case: Case, seed: int) -> Array:
        """Poses X_SO (N, 4, 4), the best first."""


def registrations() -> list[Registration]:
    """The methods that can be used, ours first."""
    found: list[Registration] = [Ours()]
    refiner = best_peer()
    if refiner is None:
        return found
    if installed("open3d"):
        found += [Open3dRansac(refiner), Open3dFgr(refiner)]
    if installed("ppf_match_3d"):
        found.append(OpencvPpf(refiner))
    return found


class Ours:
    """The pose of best LCP, then the 25 representatives."""

    name = "physim-drake"
    candidates = slice(1, None)  # the representatives

    def __init__(self) -> None:
        self.refiner: Refiner = ours()

    def prepare(self, model: ObjectModel) -> Any:
        """Its distance field and pairs, which are kept with the model."""
        return registration_model(model), pair_index(model)

    def propose(self, prepared: Any, case: Case, seed: int) -> Array:
        """As `estimate` makes them."""
        segment = case.segment
        found = generate_hypotheses(
            case.model,
            case.scene,
            segment.points,
            segment.normals,
            np.random.default_rng([seed, case.index]),
        )
        if len(found.X_SO) == 0:
            return found.X_SO
        best = found.X_SO[[int(found.lcp.argmax())]]
        return np.concatenate([best, found.poses])


class Open3dRansac:
    """Fast point feature histograms matched by RANSAC."""

    name = "Open3D FPFH + RANSAC"
    candidates = slice(None)

    def __init__(self, refiner: Refiner) -> None:
        import open3d

        self._o3d, self.refiner = open3d, refiner

    def prepare(self, model: ObjectModel) -> Any:
        """A cloud and its features."""
        return self._featured(*model.surface_sample(MODEL_POINTS))

    def propose(self, prepared: Any, case: Case, seed: int) -> Array:
        """One pose."""
        self._o3d.utility.random.seed(seed)
        source = self._featured(case.segment.points, case.segment.normals)
        result = self._match(*source, *prepared)
        return inverse(np.asarray(result.transformation))[None]

    def _featured(self, points: Array, normals: Array) -> tuple[Any, Any]:
        cloud = self._o3d.geometry.PointCloud()
        cloud.points = self._o3d.utility.Vector3dVector(np.array(points))
        cloud.normals = self._o3d.utility.Vector3dVector(np.array(normals))
        around = self._o3d.geometry.KDTreeSearchParamHybrid(
            radius=5 * _VOXEL, max_nn=100
        )
        features = self._o3d.pipelines.registration.compute_fpfh_feature(cloud, around)
        return cloud, features

    def _match(self, source: Any, features: Any, target: Any, others: Any) -> Any:
        r = self._o3d.pipelines.registration
        reach = 1.5 * _VOXEL
        return r.registration_ransac_based_on_feature_matching(
            source,
            target,
            features,
            others,
            mutual_filter=True,
            max_correspondence_distance=reach,
            estimation_method=r.TransformationEstimationPointToPoint(False),
            ransac_n=3,
            checkers=[
                r.CorrespondenceCheckerBasedOnEdgeLength(0.9),
                r.CorrespondenceCheckerBasedOnDistance(reach),
            ],
            criteria=r.RANSACConvergenceCriteria(100_000, 0.999),
        )


class Open3dFgr(Open3dRansac):
    """The same features matched by fast global registration."""

    name = "Open3D FPFH + FGR"

    def _match(self, source: Any, features: Any, target: Any, others: Any) -> Any:
        r = self._o3d.pipelines.registration
        return r.registration_fgr_based_on_feature_matching(
            source,
            target,
            features,
            others,
            r.FastGlobalRegistrationOption(maximum_correspondence_distance=_VOXEL / 2),
        )


class OpencvPpf:
    """Point pair features of Drost et al. 2010, its poses by their votes."""

    name = "OpenCV PPF"
    candidates = slice(None)
    _SAMPLING = 0.08  # of the diameter, since the default of 0.05 takes seconds

    def __init__(self, refiner: Refiner) -> None:
        self.refiner = refiner

    def prepare(self, model: ObjectModel) -> Any:
        """A trained detector, in millimetres."""
        import cv2

        detector = cv2.ppf_match_3d.PPF3DDetector(self._SAMPLING, self._SAMPLING)
        detector.trainModel(self._cloud(*model.surface_sample(MODEL_POINTS)))
        return detector

    def propose(self, prepared: Any, case: Case, seed: int) -> Array:
        """Up to 25 poses, without a random choice."""
        cloud = self._cloud(case.segment.points, case.segment.normals)
        found = prepared.match(cloud, 1 / 5, self._SAMPLING)
        poses = np.array([pose.pose for pose in found[:25]]).reshape(-1, 4, 4)
        poses[:, :3, 3] /= 1000
        return poses

    def _cloud(self, points: Array, normals: Array) -> np.ndarray:
        return np.hstack([1000 * points, normals]).astype(np.float32)
