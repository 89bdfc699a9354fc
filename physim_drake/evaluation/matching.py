# SPDX-License-Identifier: MIT
"""Matches estimates with true poses, and says how far each object is off.

This is the only rule in the package: instances of an object are matched one to one so
that the costs add up to the least. The cost is the distance of the origins for poses,
and the distance in the image for detections.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from physim_drake.camera import CameraIntrinsics
from physim_drake.datasets.bop import GroundTruthPose
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.observation import Detection
from physim_drake.pose_errors import pose_error
from physim_drake.poses import Array
from physim_drake.scene_estimate import SceneEstimate

VISIBLE_FRACTION = 0.1
"""Share of its silhouette that an instance must show to count (BOP challenge 2019)."""


@dataclass(frozen=True)
class ObjectPose:
    """An object at a true or an estimated pose.

    Attributes:
        name: name of the object, or of this instance of it.
        object_id: id of the object.
        X_FO: pose, (4, 4), m, in a frame F that all compared poses share.
        confidence: confidence of an estimate, 0..1.
    """

    name: str
    object_id: int
    X_FO: Array
    confidence: float = 1.0


@dataclass(frozen=True)
class ObjectError:
    """How far one true object and the estimate matched with it are apart.

    Attributes:
        name: name of the true object.
        object_id: id of the object.
        rotation: rotation angle, least over the symmetries, rad; None if the object was
            not found.
        translation: distance of the origins, m; None if the object was not found.
        confidence: confidence of the estimate, 0..1; 0 if the object was not found.
    """

    name: str
    object_id: int
    rotation: float | None = None
    translation: float | None = None
    confidence: float = 0.0

    @property
    def found(self) -> bool:
        """Whether an estimate was matched with the object."""
        return self.rotation is not None

    @property
    def rotation_deg(self) -> float | None:
        """Rotation angle in degrees; None if the object was not found."""
        return None if self.rotation is None else float(np.degrees(self.rotation))

    def within(self, max_rotation_deg: float, max_translation_m: float) -> bool:
        """Whether the object was found and is off by no more than this."""
        return (
            self.rotation_deg is not None
            and self.translation is not None
            and self.rotation_deg <= max_rotation_deg
            and self.translation <= max_translation_m
        )

    def __str__(self) -> str:
        if self.rotation_deg is None or self.translation is None:
            return f"{self.name}: not found"
        return (
            f"{self.name}: off by {self.rotation_deg:.2f} deg, "
            f"{1000 * self.translation:.1f} mm, confidence {self.confidence:.2f}"
        )


def poses_in_camera(estimate: SceneEstimate) -> list[ObjectPose]:
    """The found objects of an estimate, with X_CO."""
    return [
        ObjectPose(o.name, o.object_id, o.X_CO, o.confidence)
        for o in estimate.objects
        if o.X_CO is not None
    ]


def poses_in_world(estimate: SceneEstimate) -> list[ObjectPose]:
    """The found objects of an estimate, with X_WO."""
    return [
        ObjectPose(o.name, o.object_id, o.X_WO, o.confidence)
        for o in estimate.objects
        if o.X_WO is not None
    ]


def object_errors(
    found: Iterable[ObjectPose], true: Iterable[ObjectPose], library: ObjectLibrary
) -> tuple[ObjectError, ...]:
    """Compares every true object with the estimate of it.

    Args:
        found: estimated poses.
        true: true poses, in the same frame.
        library: models of the objects, for their symmetries.

    Returns:
        one error for each true object, in their order.
    """
    found, true = list(found), list(true)
    matches = match_objects(
        [t.object_id for t in true],
        [f.object_id for f in found],
        origin_distances([t.X_FO for t in true], [f.X_FO for f in found]),
    )
    return tuple(
        ObjectError(t.name, t.object_id) if k is None else _error(t, found[k], library)
        for t, k in zip(true, matches, strict=True)
    )


def _error(true: ObjectPose, found: ObjectPose, library: ObjectLibrary) -> ObjectError:
    error = pose_error(true.X_FO, found.X_FO, library[true.object_id].symmetry)
    return ObjectError(
        true.name, true.object_id, error.geodesic, error.translation, found.confidence
    )


def match_detections_with_truth(
    detections: Sequence[Detection],
    truth: Sequence[GroundTruthPose],
    intrinsics: CameraIntrinsics,
) -> list[GroundTruthPose | None]:
    """Matches each detection with the true object that it shows.

    The cost is the distance from the middle of the box to where the true origin
    projects, px.

    Args:
        detections: boxes in the image.
        truth: true poses in the camera.
        intrinsics: the camera.

    Returns:
        the true object of each detection; None for those that are left over.
    """
    wanted = [d.object_id for d in detections]
    visible = [
        truth[k]
        for object_id in dict.fromkeys(wanted)
        for k in visible_instances(truth, object_id, wanted.count(object_id))
    ]
    middles = np.reshape([(d.box[:2] + d.box[2:]) / 2 for d in detections], (-1, 2))
    origins = intrinsics.project(np.reshape([t.X_CO[:3, 3] for t in visible], (-1, 3)))
    distances = np.linalg.norm(middles[:, None] - origins[None], axis=2)
    matches = match_objects(wanted, [t.object_id for t in visible], distances)
    return [None if k is None else visible[k] for k in matches]


def visible_instances(
    truth: Sequence[GroundTruthPose], object_id: int, count: int
) -> list[int]:
    """Indices of an object's true instances that estimates are compared with.

    These are the instances that show at least `VISIBLE_FRACTION` of themselves, or for
    which the dataset does not say. If there are fewer than `count`, the most visible
    of the others make up the number.

    Args:
        truth: true poses of all objects in an image.
        object_id: id of the object.
        count: number of instances that are wanted.
    """
    shown = {
        k: 1.0 if pose.visible_fraction is None else pose.visible_fraction
        for k, pose in enumerate(truth)
        if pose.object_id == object_id
    }
    visible = [k for k, share in shown.items() if share >= VISIBLE_FRACTION]
    hidden = sorted(shown.keys() - set(visible), key=lambda k: (-shown[k], k))
    return sorted([*visible, *hidden[: max(count - len(visible), 0)]])


def match_objects(
    ids: Sequence[int], other_ids: Sequence[int], costs: Array
) -> list[int | None]:
    """Matches two lists of objects one to one so that the costs add up to the least.

    Instances of an object are matched only with each other, and as many as possible.

    Args:
        ids: object ids of the first list, N.
        other_ids: object ids of the second list, M.
        costs: cost of each match, (N, M).

    Returns:
        for each of the first list its match's index in the second, or None.
    """
    matches: list[int | None] = [None] * len(ids)
    for object_id in dict.fromkeys(ids):
        rows = [k for k, i in enumerate(ids) if i == object_id]
        columns = [k for k, i in enumerate(other_ids) if i == object_id]
        pairs = linear_sum_assignment(costs[np.ix_(rows, columns)])
        for row, column in zip(*pairs, strict=True):
            matches[rows[row]] = columns[column]
    return matches


def origin_distances(X_FO: Sequence[Array], X_FO_other: Sequence[Array]) -> Array:
    """Distances of the origins of N and M poses (4, 4) in one frame, m, (N, M)."""
    p = np.reshape([X[:3, 3] for X in X_FO], (-1, 3))
    q = np.reshape([X[:3, 3] for X in X_FO_other], (-1, 3))
    return np.asarray(np.linalg.norm(p[:, None] - q[None], axis=2))
