# SPDX-License-Identifier: MIT
"""Ways to refine a pose that is nearly right.

All align the points of the segment to the model, each point to what is nearest of the
model within 2 cm (ours within 7.5 mm). The time does not include what is
made of the model, but it includes what is made of the segment.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.peers.cases import Case
from benchmarks.peers.installed import installed
from physim_drake.objects.model import ObjectModel
from physim_drake.poses import Array, inverse
from physim_drake.registration.registration_model import registration_model
from physim_drake.registration.trimmed_icp import TrimmedIcpConfig, trimmed_icp

MODEL_POINTS = 4000  # about 4 mm apart, the segments' 3 mm
_REACH = 0.02
_ITERATIONS = 30


@dataclass(frozen=True)
class Refiner:
    """A method of refinement.

    Attributes:
        name: name of the method.
        prepare: function that makes what it needs of a model.
        refine: function from that, a case and X_SO (4, 4) to a better X_SO.
    """

    name: str
    prepare: Callable[[ObjectModel], Any]
    refine: Callable[[Any, Case, Array], Array]


def ours() -> Refiner:
    """Trimmed ICP on the model's distance field, as the search does it."""
    config = TrimmedIcpConfig(iterations=_ITERATIONS)

    def refine(prepared: Any, case: Case, X_SO: Array) -> Array:
        points, normals = case.segment.points, case.segment.normals
        poses, _ = trimmed_icp(prepared, X_SO[None], points, normals, config)
        return poses[0]

    return Refiner(
        "physim-drake trimmed ICP",
        lambda model: registration_model(model).distance_field,
        refine,
    )


def peers() -> list[Refiner]:
    """Those of the other packages that can be used."""
    found = []
    if installed("small_gicp"):
        found += [_small_gicp("GICP"), _small_gicp("PLANE_ICP")]
    if installed("open3d"):
        found += [_open3d(robust=False), _open3d(robust=True)]
    return found


def best_peer() -> Refiner | None:
    """What the poses of other packages are refined with: the robust one, if there."""
    return next(iter(reversed(peers())), None)


def _small_gicp(kind: str) -> Refiner:
    import small_gicp

    def prepare(model: ObjectModel) -> Any:
        return _prepared(model.surface_sample(MODEL_POINTS)[0])

    def _prepared(points: Array) -> Any:
        # Points closer than this are joined. Those of segments are already 3 mm apart.
        return small_gicp.preprocess_points(
            points, downsampling_resolution=0.002, num_neighbors=20, num_threads=1
        )

    def refine(prepared: Any, case: Case, X_SO: Array) -> Array:
        """The refined X_SO (4, 4)."""
        target, tree = prepared
        source, _ = _prepared(case.segment.points)
        result = small_gicp.align(
            target,
            source,
            tree,
            inverse(X_SO),
            registration_type=kind,
            max_correspondence_distance=_REACH,
            num_threads=1,
            max_iterations=_ITERATIONS,
            rotation_epsilon=1e-4,
            translation_epsilon=1e-5,
        )
        return inverse(np.asarray(result.T_target_source))

    return Refiner(f"small_gicp {kind.replace('_', ' ')}", prepare, refine)


def _open3d(*, robust: bool) -> Refiner:
    import open3d

    r = open3d.pipelines.registration

    def cloud(points: Array, normals: Array) -> Any:
        made = open3d.geometry.PointCloud()
        made.points = open3d.utility.Vector3dVector(np.array(points))
        made.normals = open3d.utility.Vector3dVector(np.array(normals))
        return made

    def refine(prepared: Any, case: Case, X_SO: Array) -> Array:
        """The refined X_SO (4, 4)."""
        kernel = (r.TukeyLoss(0.005),) if robust else ()
        result = r.registration_icp(
            cloud(case.segment.points, case.segment.normals),
            prepared,
            _REACH,
            inverse(X_SO),
            r.TransformationEstimationPointToPlane(*kernel),
            r.ICPConvergenceCriteria(1e-7, 1e-7, _ITERATIONS),
        )
        return inverse(np.asarray(result.transformation))

    return Refiner(
        f"Open3D point-to-plane{', Tukey' if robust else ''}",
        lambda model: cloud(*model.surface_sample(MODEL_POINTS)),
        refine,
    )
