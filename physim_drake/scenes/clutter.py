# SPDX-License-Identifier: MIT
"""Distractors and a room: shapes around the objects of a scene.

They appear in the images and the depth, but have no label and no contact.
"""

from __future__ import annotations

import numpy as np
from pydrake.geometry import Box, Capsule, Cylinder, Ellipsoid, Shape, Sphere
from scipy.spatial.transform import Rotation

from physim_drake.poses import Array, make_pose
from physim_drake.rendering.scene import Prop
from physim_drake.rendering.vivid import draw_print, draw_texture

_REACH = (0.15, 0.5)  # m from the middle of the container
_GAP = 0.01  # m
_TRIES = 10
_FLOOR = -0.75  # m below the surface
_FURNITURE = (1.3, 3.0)  # m from the middle


def draw_distractors(
    circles: Array, most: int, height: float, rng: np.random.Generator
) -> list[Prop]:
    """Draws shapes that lie or stand around the objects on the surface.

    Args:
        circles: x, y and radius (m) of the areas that the objects take up, (N, 3).
        most: greatest number of shapes; the mean is half of it.
        height: free height above the surface, m.
        rng: source of all random choices.
    """
    props: list[Prop] = []
    taken = [tuple(circle) for circle in circles]
    spread = rng.uniform(*_REACH)
    for _ in range(int(rng.integers(0, most + 1))):
        shape, R_WP, half, reach = _draw_shape(rng)
        for _ in range(_TRIES):
            x, y = rng.uniform(-spread, spread, 2)
            free = all(np.hypot(x - u, y - v) > r + reach + _GAP for u, v, r in taken)
            if free and 2 * half < height:
                taken.append((x, y, reach))
                looks = draw_print if rng.random() < 0.5 else draw_texture
                props.append(Prop(shape, make_pose(R_WP, [x, y, half]), looks(rng)))
                break
    return props


def draw_room(rng: np.random.Generator) -> list[Prop]:
    """A floor below the surface and furniture-sized boxes around it."""
    floor = make_pose(p=[0.0, 0.0, _FLOOR - 0.05])
    props = [Prop(Box(9.0, 9.0, 0.1), floor, draw_texture(rng))]
    for _ in range(int(rng.integers(2, 7))):
        size = rng.uniform([0.1, 0.1, 0.3], [1.2, 1.2, 1.6])
        bearing, distance = rng.uniform(-np.pi, np.pi), rng.uniform(*_FURNITURE)
        p_WP = [
            distance * np.cos(bearing),
            distance * np.sin(bearing),
            _FLOOR + size[2] / 2,
        ]
        R_WP = _turned(rng)
        props.append(Prop(Box(*size), make_pose(R_WP, p_WP), draw_texture(rng)))
    return props


def _draw_shape(rng: np.random.Generator) -> tuple[Shape, Array, float, float]:
    """A shape, its orientation R_WP, half its height and its radius on the floor, m."""
    a, b, c = (float(x) for x in rng.uniform(0.015, 0.08, 3))
    upright = _turned(rng)
    lying = upright @ Rotation.from_euler("y", np.pi / 2).as_matrix()
    kind = int(rng.integers(7))
    if kind <= 2:
        return Box(2 * a, 2 * b, 2 * c), upright, c, float(np.hypot(a, b))
    if kind == 3:
        return Cylinder(a, 2 * b), upright, b, a
    if kind == 4:
        return Cylinder(a, 2 * b), lying, a, float(np.hypot(a, b))
    if kind == 5:
        return Capsule(a, 2 * b), lying, a, a + b
    if rng.random() < 0.5:
        return Sphere(a), upright, a, a
    return Ellipsoid(a, b, c), upright, c, max(a, b)


def _turned(rng: np.random.Generator) -> Array:
    angle = rng.uniform(-np.pi, np.pi)
    return np.asarray(Rotation.from_euler("z", angle).as_matrix())
