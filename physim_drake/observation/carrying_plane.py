# SPDX-License-Identifier: MIT
"""The plane in a cloud that most likely carries the objects, by RANSAC."""

from __future__ import annotations

import numpy as np

from physim_drake.errors import InputError
from physim_drake.poses import Array

_ITERATIONS = 1500
_MAX_TILT = np.radians(30.0)
_MAX_BELOW = 0.1  # of the detections' points
_OBJECT_HEIGHT = 0.3  # m; planes that the objects are farther above count for less
_NEAR = 0.5  # of that height: nearer planes carry what is above them
_DOUBTED = 0.25  # of the best plane's score: an upright one with less is no surface
_MIN_SUPPORT = 50


class NoSurfaceError(InputError):
    """No plane in the image carries the objects."""


def depth_tolerance(z: Array) -> Array:
    """A cautious standard deviation (m) of a depth camera's reading at `z` (m).

    Twice the quadratic law of structured-light and stereo cameras of the RealSense
    class at half a metre.
    """
    return np.asarray(0.0005 + 0.002 * np.square(z))


def carrying_plane(
    points: Array,
    objects: Array,
    up_C: Array | None,
    factor: float,
    generator: np.random.Generator,
) -> tuple[Array, float, bool]:
    """The plane with most points on it and no objects below.

    Args:
        points: cloud around the objects, (N, 3), m, in C.
        objects: cloud of the objects, (M, 3), m, in C; may be empty.
        up_C: direction opposite to gravity, (3,), if it is known.
        factor: by which lengths are multiplied, see `ObjectSizes`.
        generator: for the random samples.

    Returns:
        unit normal, towards the camera; offset, m, the camera's height; and whether the
        plane contradicts `up_C`, since no plane that agrees carries the objects.

    Raises:
        NoSurfaceError: if there is none.
    """
    normals, offsets = _candidates(points, factor, generator)
    band = 3 * depth_tolerance(points[:, 2])[:, None]
    support = (np.abs(points @ normals.T + offsets) < band).sum(axis=0)
    score = support.astype(float)
    carries = np.zeros(len(normals), dtype=bool)
    if len(objects):
        band = 10 * depth_tolerance(objects[:, 2])[:, None]
        heights = objects @ normals.T + offsets
        score *= (heights < -band).mean(axis=0) < _MAX_BELOW
        # A wall or the floor may have nothing below it either, but is far away.
        middle = np.median(heights, axis=0) / (_OBJECT_HEIGHT * factor)
        score /= 1 + np.square(middle)
        carries = middle < _NEAR
    score *= support >= _MIN_SUPPORT
    upright = score
    if up_C is not None:
        upright = np.where(normals @ up_C > np.cos(_MAX_TILT), score, 0.0)
    # Only a plane that carries something tells of the camera.
    carrying = np.where(carries, score, 0.0)
    doubted = upright.max(initial=0.0) < _DOUBTED * carrying.max(initial=0.0)
    chosen = carrying if doubted else upright
    if chosen.max(initial=0.0) == 0:
        raise NoSurfaceError(
            "support surface",
            "no plane found under the objects",
            "give its height (--surface Z) or images that show more of it",
        )
    best = int(chosen.argmax())
    return normals[best], float(offsets[best]), bool(doubted)


def _candidates(
    points: Array, factor: float, generator: np.random.Generator
) -> tuple[Array, Array]:
    """Planes through three of the points each: unit normals (K, 3), offsets (K,)."""
    triples = points[generator.integers(len(points), size=(_ITERATIONS, 3))]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    good = lengths > 1e-5 * factor**2
    normals, triples = normals[good] / lengths[good, None], triples[good]
    # The camera looks at the surface from above: its origin has a positive height.
    offsets = -np.einsum("ni,ni->n", normals, triples[:, 0])
    flip = np.where(offsets < 0, -1.0, 1.0)
    return normals * flip[:, None], offsets * flip


def fitted_plane(points: Array, weights: Array) -> tuple[Array, float]:
    """Weighted least-squares plane through points (N, 3): unit normal, offset."""
    centre = np.average(points, axis=0, weights=weights)
    centred = (points - centre) * weights[:, None]
    normal = np.linalg.eigh(centred.T @ centred)[1][:, 0]
    offset = -float(normal @ centre)
    return (normal, offset) if offset > 0 else (-normal, -offset)
