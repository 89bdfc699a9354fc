# SPDX-License-Identifier: MIT
"""Helpers for integration tests against simulated or recorded ground truth.

from physim_drake.testing import assert_poses_close

estimate = estimate_scene(observation, library, detections)
assert_poses_close(estimate, truth, library, max_rotation_deg=3.0)
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from physim_drake.datasets.bop import GroundTruthPose
from physim_drake.estimate import SceneEstimate
from physim_drake.evaluation.pose_errors import pose_error
from physim_drake.objects import ObjectLibrary
from physim_drake.poses import Array


@dataclass(frozen=True)
class Comparison:
    """One true object and the estimate matched with it.

    Attributes:
        name: the object's.
        rotation_deg: rotation angle between them, least over the symmetries; None
            where the object was not found.
        translation_m: distance of the origins; None where the object was not found.
    """

    name: str
    rotation_deg: float | None
    translation_m: float | None

    def within(self, max_rotation_deg: float, max_translation_m: float) -> bool:
        """Whether the object was found and is off by no more than this."""
        return (
            self.rotation_deg is not None
            and self.translation_m is not None
            and self.rotation_deg <= max_rotation_deg
            and self.translation_m <= max_translation_m
        )

    def __str__(self) -> str:
        if self.rotation_deg is None or self.translation_m is None:
            return f"{self.name}: not found"
        return (
            f"{self.name}: off by {self.rotation_deg:.2f} deg, "
            f"{1000 * self.translation_m:.1f} mm"
        )


def compare_poses(
    estimate: SceneEstimate,
    ground_truth: Iterable[GroundTruthPose],
    library: ObjectLibrary,
) -> list[Comparison]:
    """Compares every true object with the estimate of it.

    Several instances of one object are matched so that their distances add up to the
    least.

    Args:
        estimate: with poses in the camera.
        ground_truth: true poses in the same camera.
        library: for names and symmetries.

    Returns:
        one comparison for each true object, grouped by object id.
    """
    truths: dict[int, list[Array]] = {}
    for truth in ground_truth:
        truths.setdefault(truth.object_id, []).append(truth.X_CO)
    compared: list[Comparison] = []
    for object_id, X_CO_true in truths.items():
        found = [
            o.X_CO
            for o in estimate.objects
            if o.object_id == object_id and o.X_CO is not None
        ]
        model = library[object_id]
        costs = np.array(
            [[np.linalg.norm(X[:3, 3] - T[:3, 3]) for X in found] for T in X_CO_true]
        ).reshape(len(X_CO_true), len(found))
        rows, columns = linear_sum_assignment(costs)
        matches = dict(zip(rows.tolist(), columns.tolist(), strict=True))
        for n, T in enumerate(X_CO_true):
            if n not in matches:
                compared.append(Comparison(model.name, None, None))
                continue
            error = pose_error(T, found[matches[n]], model.symmetry)
            angle = float(np.degrees(error.geodesic))
            compared.append(Comparison(model.name, angle, error.translation))
    return compared


def assert_poses_close(
    estimate: SceneEstimate,
    ground_truth: Iterable[GroundTruthPose],
    library: ObjectLibrary,
    max_rotation_deg: float = 5.0,
    max_translation_m: float = 0.01,
) -> None:
    """Asserts that every true object was found, and near where it is.

    Args:
        estimate: with poses in the camera.
        ground_truth: true poses in the same camera.
        library: for names and symmetries.
        max_rotation_deg: largest rotation angle, least over the symmetries.
        max_translation_m: largest distance of the origins.

    Raises:
        AssertionError: naming each object that is missing or off, and by how much.
    """
    compared = compare_poses(estimate, ground_truth, library)
    wrong = [c for c in compared if not c.within(max_rotation_deg, max_translation_m)]
    if wrong:
        listed = "\n  ".join(str(c) for c in wrong)
        raise AssertionError(
            f"{len(wrong)} of {len(compared)} objects are farther off than "
            f"{max_rotation_deg:g} deg or {1000 * max_translation_m:g} mm:\n  {listed}"
        )
