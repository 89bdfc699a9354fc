# SPDX-License-Identifier: MIT
"""Depth windows of single objects, rasterised on the spot.

The search draws hundreds of objects an image, each of some thousand pixels. A loop over
the triangles does that several times faster than a round trip through OpenGL, and
worker processes do not need an OpenGL context. `DepthRenderer`, which draws with Drake,
is the reference: both agree to fractions of a millimetre inside, and to few pixels
along the outline.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from physim_drake.camera import CameraIntrinsics, DepthImage
from physim_drake.compiled import compiled
from physim_drake.objects.model import ObjectModel
from physim_drake.poses import Array
from physim_drake.rendering.windows import DepthWindow

Faces = NDArray[np.int32]

_NEAR, _FAR = 0.05, 8.0  # m, as in `DepthRenderer`
_ON_EDGE = 1e-7  # square pixels: neither of two triangles may miss their common edge


class DepthRasterizer:
    """Draws depth windows of one object at a time.

    Args:
        models: models of the objects, by id.
        intrinsics: intrinsics of the camera.
    """

    def __init__(
        self, models: Mapping[int, ObjectModel], intrinsics: CameraIntrinsics
    ) -> None:
        self.intrinsics = intrinsics
        self._models = models
        self._meshes: dict[int, tuple[Array, Faces, bool]] = {}

    def window(self, object_id: int, X_CO: Array) -> DepthWindow:
        """Draws the object alone.

        Args:
            object_id: id of the object.
            X_CO: pose of the object in the camera, (4, 4).

        Returns:
            the smallest window that holds its vertices. Triangles that reach nearer
            than 5 cm to the camera are left out.
        """
        if object_id not in self._meshes:
            mesh = self._models[object_id].mesh
            self._meshes[object_id] = (
                np.ascontiguousarray(mesh.vertices, dtype=float),
                np.ascontiguousarray(mesh.faces, dtype=np.int32),
                bool(mesh.is_volume),  # closed: what faces away is not visible
            )
        vertices, faces, closed = self._meshes[object_id]
        K = self.intrinsics
        projected = np.empty((len(vertices), 3))
        row, column, height, width = _project(
            vertices,
            np.ascontiguousarray(X_CO),
            np.array([K.fx, K.fy, K.cx, K.cy]),
            K.height,
            K.width,
            projected,
        )
        depth = np.zeros((height, width), dtype=np.float32)
        _rasterize(projected, faces, closed, row, column, depth)
        return DepthWindow(row, column, depth)


@compiled(error_model="numpy")
def _project(
    vertices: Array, X_CO: Array, K: Array, height: int, width: int, projected: Array
) -> tuple[int, int, int, int]:
    """Writes u, v, 1/z of each vertex to `projected`, 1/z = 0 for those too near.

    Returns:
        first row, first column, height and width of the window they lie in.
    """
    top, left, bottom, right = float(height), float(width), -1.0, -1.0
    for n in range(len(vertices)):
        p = vertices[n]
        x = X_CO[0, 0] * p[0] + X_CO[0, 1] * p[1] + X_CO[0, 2] * p[2] + X_CO[0, 3]
        y = X_CO[1, 0] * p[0] + X_CO[1, 1] * p[1] + X_CO[1, 2] * p[2] + X_CO[1, 3]
        z = X_CO[2, 0] * p[0] + X_CO[2, 1] * p[1] + X_CO[2, 2] * p[2] + X_CO[2, 3]
        if not z > _NEAR:
            projected[n, 2] = 0.0
            continue
        u, v = K[0] * x / z + K[2], K[1] * y / z + K[3]
        projected[n, 0], projected[n, 1], projected[n, 2] = u, v, 1 / z
        top, bottom = min(top, v), max(bottom, v)
        left, right = min(left, u), max(right, u)
    first_row = int(np.ceil(max(top, 0.0)))
    first_column = int(np.ceil(max(left, 0.0)))
    rows = int(np.floor(min(bottom, height - 1.0))) + 1 - first_row
    columns = int(np.floor(min(right, width - 1.0))) + 1 - first_column
    if rows <= 0 or columns <= 0:
        return 0, 0, 0, 0
    return first_row, first_column, rows, columns


@compiled(error_model="numpy")
def _rasterize(
    projected: Array,
    faces: Faces,
    closed: bool,
    row: int,
    column: int,
    depth: DepthImage,
) -> None:
    """Draws the triangles into a window whose first pixel is (row, column)."""
    height, width = depth.shape
    # Inverse depth is linear in the image; the largest is nearest.
    for f in range(len(faces)):
        a, b, c = projected[faces[f, 0]], projected[faces[f, 1]], projected[faces[f, 2]]
        if a[2] == 0 or b[2] == 0 or c[2] == 0:
            continue
        ax, ay, bx, by = a[0] - column, a[1] - row, b[0] - column, b[1] - row
        cx, cy = c[0] - column, c[1] - row
        # Counterclockwise seen from outside, so clockwise in an image with y down.
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if (closed and area > 0) or abs(area) < _ON_EDGE:
            continue
        top = int(np.ceil(max(min(ay, by, cy), 0.0)))
        bottom = int(np.floor(min(max(ay, by, cy), height - 1.0)))
        left = int(np.ceil(max(min(ax, bx, cx), 0.0)))
        right = int(np.floor(min(max(ax, bx, cx), width - 1.0)))
        side = 1.0 if area > 0 else -1.0
        for v in range(top, bottom + 1):
            for u in range(left, right + 1):
                at_a = side * ((bx - u) * (cy - v) - (by - v) * (cx - u))
                at_b = side * ((cx - u) * (ay - v) - (cy - v) * (ax - u))
                at_c = side * ((ax - u) * (by - v) - (ay - v) * (bx - u))
                if at_a >= -_ON_EDGE and at_b >= -_ON_EDGE and at_c >= -_ON_EDGE:
                    inverse = (at_a * a[2] + at_b * b[2] + at_c * c[2]) / abs(area)
                    depth[v, u] = max(depth[v, u], np.float32(inverse))
    for v in range(height):
        for u in range(width):
            if depth[v, u] > 0:
                z = 1 / depth[v, u]
                depth[v, u] = z if z < _FAR else np.float32(0)
