# SPDX-License-Identifier: MIT
"""Heights of a surface under the lip of a cup that is held over it.

A cup's rays are parallel and close together, so faces that are far from the cup's axis
are left out first; that makes hundreds of cups on thousands of faces a matter of
milliseconds.
"""

from __future__ import annotations

import math

import numpy as np
import trimesh

from physim_drake.compiled import compiled
from physim_drake.poses import Array


def plane_axes(normals: Array) -> tuple[Array, Array]:
    """Two unit vectors (N, 3) each that make a right-handed frame with the normals."""
    helper = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
    x = np.cross(helper, normals)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return x, np.asarray(np.cross(normals, x), np.float64)


def surface_heights(
    mesh: trimesh.Trimesh, centers: Array, normals: Array, pattern: Array, reach: float
) -> Array:
    """Casts a pattern of rays onto a surface, along the negative normal of each cup.

    Args:
        mesh: the surface, in O, m.
        centers: points p_O in which the cups' axes meet the surface, (N, 3), m.
        normals: outward axes of the cups, unit, (N, 3).
        pattern: offsets of the rays in the plane of the cup, (R, 2), m, along the axes
            of `plane_axes`.
        reach: rays begin at this height over the centre and end as far below it, m.

    Returns:
        the height of the highest point that each ray meets, over the plane through the
        centre, (N, R), m; NaN if it meets no face.
    """
    x, y = plane_axes(normals)
    triangles = np.ascontiguousarray(mesh.triangles, dtype=float)
    middles = triangles.mean(axis=1)
    radii = np.linalg.norm(triangles - middles[:, None], axis=2).max(axis=1)
    heights = np.full((len(centers), len(pattern)), np.nan)
    frames = np.ascontiguousarray(np.stack([x, y, normals], axis=1), dtype=float)
    _cast(
        triangles,
        middles,
        radii,
        np.ascontiguousarray(centers, dtype=float),
        frames,
        np.ascontiguousarray(pattern, dtype=float),
        reach,
        heights,
    )
    return heights


@compiled(error_model="numpy")
def _cast(
    triangles: Array,
    middles: Array,
    radii: Array,
    centers: Array,
    frames: Array,
    pattern: Array,
    reach: float,
    heights: Array,
) -> None:
    widest = 0.0
    for r in range(len(pattern)):
        widest = max(widest, math.hypot(pattern[r, 0], pattern[r, 1]))
    local = np.empty((3, 3))  # the face's corners, in the cup's frame
    for n in range(len(centers)):
        px, py, pz = centers[n]
        ax, ay, az = frames[n, 2]
        for f in range(len(triangles)):
            dx, dy, dz = middles[f, 0] - px, middles[f, 1] - py, middles[f, 2] - pz
            along = dx * ax + dy * ay + dz * az
            near = widest + radii[f]
            squared = dx * dx + dy * dy + dz * dz - along * along
            if squared > near * near or abs(along) > reach + radii[f]:
                continue
            for corner in range(3):
                dx = triangles[f, corner, 0] - px
                dy = triangles[f, corner, 1] - py
                dz = triangles[f, corner, 2] - pz
                for axis in range(3):
                    local[corner, axis] = (
                        dx * frames[n, axis, 0]
                        + dy * frames[n, axis, 1]
                        + dz * frames[n, axis, 2]
                    )
            _hit(local, pattern, reach, heights[n])


@compiled(error_model="numpy")
def _hit(corners: Array, pattern: Array, reach: float, heights: Array) -> None:
    """Raises `heights` to where vertical rays meet one face."""
    ax, ay, az = corners[0]
    bx, by, bz = corners[1, 0] - ax, corners[1, 1] - ay, corners[1, 2] - az
    cx, cy, cz = corners[2, 0] - ax, corners[2, 1] - ay, corners[2, 2] - az
    area = bx * cy - by * cx
    if abs(area) < 1e-14:  # seen edge on
        return
    for r in range(len(pattern)):
        px, py = pattern[r, 0] - ax, pattern[r, 1] - ay
        u = (px * cy - py * cx) / area
        v = (bx * py - by * px) / area
        if u < -1e-9 or v < -1e-9 or u + v > 1.0 + 1e-9:
            continue
        height = az + u * bz + v * cz
        if abs(height) <= reach and not height <= heights[r]:  # NaN gives way
            heights[r] = height
