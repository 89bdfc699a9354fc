# SPDX-License-Identifier: MIT
"""From where to look at the table again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from physim_drake.poses import Array, make_pose

_SIDES = {"front": 0.0, "left": -90.0, "right": 90.0}
"""Bearings as seen from the robot, degrees about z from the side that faces it."""


@dataclass(frozen=True)
class Viewpoint:
    """A place for the camera.

    Attributes:
        name: `front`, `left`, `right` or `top`, as the robot sees the target.
        X_WC: the camera's pose there, (4, 4), x level; a turn about z does not matter.
    """

    name: str
    X_WC: Array


def look_at(p_WC: Array, p_WT: Array) -> Array:
    """X_WC (4, 4) of a camera at `p_WC` that looks at `p_WT`, its x level."""
    forward = (p_WT - p_WC) / np.linalg.norm(p_WT - p_WC)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-6:  # straight up or down
        right = np.array([0.0, -1.0, 0.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    return make_pose(np.stack([right, down, forward], axis=1), p_WC)


def propose_viewpoints(
    p_WT: Array,
    p_WR: Array,
    distances: tuple[float, ...] = (0.45, 0.38, 0.55),
    elevations: tuple[float, ...] = (0.87, 1.05, 1.22),
) -> Iterator[Viewpoint]:
    """Proposes places for the camera around a target.

    All proposals of one side come before those of the next, the first wish first, so
    that whoever takes the first of each name that the arm reaches gets one a side.

    Args:
        p_WT: what to look at, (3,), m.
        p_WR: position of the robot's base, (3,), m; decides which side is the front.
        distances: distances from the target, m, in the order of preference.
        elevations: angles above the level, rad, in the order of preference.
    """
    facing = np.arctan2(p_WR[1] - p_WT[1], p_WR[0] - p_WT[0])
    for name, turn in _SIDES.items():
        bearing = facing + np.radians(turn)
        for elevation in elevations:
            for distance in distances:
                level = np.cos(elevation) * np.array([np.cos(bearing), np.sin(bearing)])
                offset = distance * np.array([*level, np.sin(elevation)])
                yield Viewpoint(name, look_at(p_WT + offset, p_WT))
    for distance in distances:
        p_WC = p_WT + np.array([0.0, 0.0, distance])
        yield Viewpoint("top", look_at(p_WC, p_WT))
