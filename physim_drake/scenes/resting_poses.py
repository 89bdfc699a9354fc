# SPDX-License-Identifier: MIT
"""Orientations in which an object can rest on a plane."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from physim_drake.objects.model import ObjectModel
from physim_drake.poses import Array

_MIN_PROBABILITY = 0.02  # rarer orientations are barely stable


@dataclass(frozen=True)
class RestingShape:
    """An object's outline and the orientations in which it rests.

    Attributes:
        outline: corners of its convex hull, p_OP (N, 3), m.
        R_WO: orientations in which it rests on a plane, (K, 3, 3); empty for a ball.
        probability: probability of each after a drop, (K,), with the sum 1.
    """

    outline: Array
    R_WO: Array
    probability: Array

    def draw(self, rng: np.random.Generator) -> Array:
        """One of the orientations with any bearing, R_WO (3, 3)."""
        if len(self.R_WO) == 0:
            return Rotation.random(rng=rng).as_matrix()
        k = rng.choice(len(self.R_WO), p=self.probability)
        return turned(self.R_WO[k], rng.uniform(-np.pi, np.pi))

    def half_width(self, R_WO: Array, direction: Array) -> float:
        """Half of the object's extent along a direction (3,) in W, m."""
        return float(np.ptp(self.outline @ R_WO.T @ direction)) / 2

    def center(self, R_WO: Array) -> Array:
        """Middle of its bounding box in W when O stands at the origin, (3,), m."""
        points = self.outline @ R_WO.T
        return np.asarray(points.min(axis=0) + points.max(axis=0)) / 2


def turned(R_WO: Array, angle: float) -> Array:
    """`R_WO` (3, 3) turned about the vertical by `angle`, rad."""
    return np.asarray(Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix() @ R_WO)


@cache
def resting_shape(model: ObjectModel) -> RestingShape:
    """Finds the orientations in which the hull of an object's collision pieces rests.

    The probability of a face is the solid angle under which its catchment area is seen
    (Goldberg et al., "Part pose statistics", IJRR 1999, as trimesh computes it).
    """
    points = np.concatenate([piece.vertices for piece in model.collision_pieces])
    hull = trimesh.Trimesh(points).convex_hull
    poses, probability = trimesh.poses.compute_stable_poses(
        hull,
        center_mass=model.center_of_mass,
        sigma=0,
        n_samples=1,
        threshold=_MIN_PROBABILITY,
    )
    return RestingShape(
        np.asarray(hull.vertices),
        np.reshape(poses, (-1, 4, 4))[:, :3, :3],
        np.asarray(probability) / max(float(np.sum(probability)), 1e-9),
    )
