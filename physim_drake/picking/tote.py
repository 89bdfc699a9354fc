# SPDX-License-Identifier: MIT
"""The tote that objects go to, and how full each part of it is thought to be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physim_drake.objects.model import ObjectLibrary
from physim_drake.picking.planner_config import HeldObject
from physim_drake.poses import Array, inverse, transform_points

_PILE = 0.35  # m; what is let go lies no higher over the tote's floor
_BELOW = 0.05  # m; nor lower
_CLEARANCE = 0.03  # m, of what is carried from what lies there

Fills = tuple[float, ...]
"""How high the tote is filled below each of its drops, m."""


@dataclass(frozen=True)
class Tote:
    """Where objects go.

    Attributes:
        X_WT: pose of its floor's middle, z up, (4, 4).
        half_extents: half lengths of the floor along its x and y, (2,), m.
        drops: points of the floor above which objects are let go, p_WD (N, 3), m.
        release_height: height of an object's lowest point above the floor when it is
            let go, m; more if the tote is full.
        carry_height: height of its lowest point when it arrives over the tote, m.
    """

    X_WT: Array
    half_extents: Array
    drops: Array
    release_height: float = 0.04
    carry_height: float = 0.2

    @property
    def empty(self) -> Fills:
        """Nothing is in it yet."""
        return (0.0,) * len(self.drops)

    def holds(self, p_W: Array) -> bool:
        """Whether a point (3,) is above or in the tote."""
        p_T = transform_points(inverse(self.X_WT), p_W[None])[0]
        inside = (np.abs(p_T[:2]) <= self.half_extents).all()
        return bool(inside and -_BELOW < p_T[2] < _PILE)

    def order(self, fills: Fills) -> list[int]:
        """The numbers of the drops, first that over the least full part of the tote."""
        return [int(n) for n in np.argsort(fills, kind="stable")]

    def over(self, drop: int, fills: Fills) -> Array:
        """The point p_WD (3,) over a drop where a carried object clears everything."""
        height = max(self.carry_height, max(fills) + _CLEARANCE)
        return np.asarray(self.drops[drop] + height * self.X_WT[:3, 2])

    def release_point(self, drop: int, fills: Fills) -> Array:
        """The point p_WD (3,) over a drop where an object is let go.

        What falls may roll, so that the height is that of the fullest place.
        """
        height = max(self.release_height, max(fills) + _CLEARANCE)
        return np.asarray(self.drops[drop] + height * self.X_WT[:3, 2])

    def filled(
        self, fills: Fills, drop: int, held: HeldObject, library: ObjectLibrary
    ) -> Fills:
        """How full it is once an object was let go at a drop, upright as it was held.

        Args:
            fills: fill height below each drop before, m.
            drop: number of the drop.
            held: the object, and how it hung at the cup.
            library: library with its model.
        """
        vertices = np.asarray(library[held.object_id].mesh.vertices)
        p_G = transform_points(held.X_GO, vertices)
        radius = float(np.linalg.norm(p_G[:, :2], axis=1).max())
        top = fills[drop] + float(np.ptp(p_G[:, 2]))
        apart = np.linalg.norm(self.drops - self.drops[drop], axis=1)
        return tuple(
            max(fill, top) if d <= radius else fill
            for fill, d in zip(fills, apart, strict=True)
        )
