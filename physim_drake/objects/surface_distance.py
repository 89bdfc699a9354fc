# SPDX-License-Identifier: MIT
"""Exact signed distances to a surface, in little memory however fine its mesh is."""

from __future__ import annotations

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import KDTree

from physim_drake.poses import Array

_BLOCK = 50  # points at a time: each may have thousands of candidate faces
_PAIRS = 100_000  # of a point and a face at a time: each needs half a kilobyte
_FIRST = 8  # faces whose distances bound that of the nearest
_SIZES = 4.0  # faces in one tree differ in size by less than this factor
_EQUAL = 1e-9  # m; faces this equally near meet where they are nearest


def signed_distances(mesh: trimesh.Trimesh, points: Array) -> Array:
    """Returns the distances of points from a surface, (N,), m, negative inside.

    A face may be nearest only if its centre is nearer than some distance that was
    found, plus its radius. Faces are kept by size, so that a few large ones do not
    make candidates of all others.

    Args:
        mesh: the closed surface, m; the signs of an open one hold near it only.
        points: (N, 3), m.
    """
    triangles = np.asarray(mesh.triangles)
    normals = np.asarray(mesh.face_normals)
    centres = triangles.mean(axis=1)
    radii = np.linalg.norm(triangles - centres[:, None], axis=2).max(axis=1)
    size = np.floor(np.log(np.maximum(radii, 1e-12)) / np.log(_SIZES))
    groups = [np.flatnonzero(size == value) for value in np.unique(size)]
    trees = [KDTree(centres[group]) for group in groups]
    bounds = np.full(len(points), np.inf)
    for group, tree in zip(groups, trees, strict=True):
        nearest = tree.query(points, k=range(1, min(_FIRST, len(group)) + 1))[1]
        for faces in group[nearest].T:
            found = _to_faces(triangles, normals, faces, points)[0]
            bounds = np.minimum(bounds, found)
    signed = np.empty(len(points))
    for start in range(0, len(points), _BLOCK):
        block = slice(start, start + _BLOCK)
        rows, faces = [], []
        for group, tree in zip(groups, trees, strict=True):
            reach = bounds[block] * (1 + 1e-9) + radii[group].max()
            near = tree.query_ball_point(points[block], reach)
            rows.append(np.repeat(np.arange(len(near)), [len(item) for item in near]))
            faces += [group[np.asarray(item, dtype=np.intp)] for item in near]
        signed[block] = _nearest(
            triangles,
            normals,
            points[block],
            np.concatenate(rows),
            np.concatenate(faces),
        )
    return signed


def _nearest(
    triangles: Array,
    normals: Array,
    points: Array,
    rows: NDArray[np.intp],
    faces: NDArray[np.intp],
) -> Array:
    """Signed distances (N,) of points (N, 3), given pairs of points and faces."""
    parts = [
        _to_faces(
            triangles, normals, faces[n : n + _PAIRS], points[rows[n : n + _PAIRS]]
        )
        for n in range(0, len(rows), _PAIRS)
    ]
    distances, heights = (np.concatenate(part) for part in zip(*parts, strict=True))
    least = np.full(len(points), np.inf)
    np.minimum.at(least, rows, distances)
    # On an edge several faces are equally near; the one that the point is most clearly
    # on a side of decides.
    tied = distances <= least[rows] + _EQUAL
    rows, heights = rows[tied], heights[tied]
    order = np.argsort(np.abs(heights), kind="stable")
    side = np.ones(len(points))
    side[rows[order]] = np.where(heights[order] < 0, -1.0, 1.0)
    return np.asarray(side * least)


def _to_faces(
    triangles: Array, normals: Array, faces: NDArray[np.intp], points: Array
) -> tuple[Array, Array]:
    """Distances (N,) of points (N, 3), each from its own face, and heights above it."""
    offsets = points - trimesh.triangles.closest_point(triangles[faces], points)
    heights = np.einsum("ni,ni->n", offsets, normals[faces])
    return np.asarray(np.linalg.norm(offsets, axis=1)), np.asarray(heights)
