# SPDX-License-Identifier: MIT
"""How far the objects of one estimated scene are from where they truly are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from physim_drake.objects.model import ObjectLibrary
from physim_drake.pose_errors import pose_error
from physim_drake.poses import Array
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate


@dataclass(frozen=True)
class TruePose:
    """Where an object truly is.

    Attributes:
        object_id: which object.
        X_WO: its pose in the world, (4, 4), m.
    """

    object_id: int
    X_WO: Array


@dataclass(frozen=True)
class ObjectError:
    """One true object and the estimate matched with it.

    Attributes:
        name: of the true object.
        object_id: which object.
        rotation: rotation angle between them, least over the symmetries, rad; None
            where the object was not found.
        translation: distance of the origins, m; None where it was not found.
        confidence: of the estimate, 0..1.
    """

    name: str
    object_id: int
    rotation: float | None = None
    translation: float | None = None
    confidence: float = 0.0

    @property
    def found(self) -> bool:
        """Whether there is an estimate of it."""
        return self.rotation is not None

    def __str__(self) -> str:
        if self.rotation is None or self.translation is None:
            return f"{self.name}: not found"
        return (
            f"{self.name}: off by {np.degrees(self.rotation):.2f} deg, "
            f"{1000 * self.translation:.1f} mm, confidence {self.confidence:.2f}"
        )


def object_errors(
    estimate: SceneEstimate, truth: Mapping[str, TruePose], library: ObjectLibrary
) -> tuple[ObjectError, ...]:
    """Compares every true object with the estimate of it.

    Several instances of one object are matched so that their distances add up to the
    least.

    Args:
        estimate: with poses in the world.
        truth: the true objects by name.
        library: for symmetries.

    Returns:
        one error for each true object, in their order.
    """
    found: dict[str, ObjectEstimate] = {}
    for object_id in {pose.object_id for pose in truth.values()}:
        names = [n for n, pose in truth.items() if pose.object_id == object_id]
        candidates = [
            o for o in estimate.objects if o.object_id == object_id and o.found
        ]
        distances = [
            [_distance(o.X_WO, truth[name].X_WO) for o in candidates] for name in names
        ]
        costs = np.reshape(distances, (len(names), len(candidates)))
        for row, column in zip(*linear_sum_assignment(costs), strict=True):
            found[names[row]] = candidates[column]
    return tuple(
        _error(name, pose, found.get(name), library) for name, pose in truth.items()
    )


def _distance(X_WO: Array | None, X_WO_true: Array) -> float:
    assert X_WO is not None
    return float(np.linalg.norm(X_WO[:3, 3] - X_WO_true[:3, 3]))


def _error(
    name: str, truth: TruePose, found: ObjectEstimate | None, library: ObjectLibrary
) -> ObjectError:
    if found is None or found.X_WO is None:
        return ObjectError(name, truth.object_id)
    error = pose_error(truth.X_WO, found.X_WO, library[truth.object_id].symmetry)
    return ObjectError(
        name, truth.object_id, error.geodesic, error.translation, found.confidence
    )
