# SPDX-License-Identifier: MIT
"""How much of what a pose would show the camera has indeed seen.

The LCP score asks how much of the segment a pose explains; this asks the reverse. A
point on the model's near side is confirmed if the depth image has it, refuted if the
camera measured something behind it or if it would be below the surface, and says
nothing if something nearer hides it.
"""

from __future__ import annotations

import math

import numpy as np

from physim_drake.camera import DepthImage
from physim_drake.compiled import compiled
from physim_drake.observation.segmented_scene import SegmentedScene
from physim_drake.poses import Array
from physim_drake.registration.registration_model import RegistrationModel

_POINTS = 100
_CLOSE = 0.01
_SUNK = 0.012


def visibility(model: RegistrationModel, X_SO: Array, scene: SegmentedScene) -> Array:
    """Confirmed points as a share of those confirmed or refuted, for many poses.

    Args:
        model: the object.
        X_SO: poses, (N, 4, 4).
        scene: the depth image and its surface.

    Returns:
        (N,) in 0..1.
    """
    step = max(1, len(model.points) // _POINTS)
    K = scene.intrinsics
    result = np.zeros(len(X_SO))
    _visibility(
        np.ascontiguousarray(model.points[::step]),
        np.ascontiguousarray(model.normals[::step]),
        np.ascontiguousarray(X_SO),
        np.ascontiguousarray(scene.X_CS),
        np.ascontiguousarray(scene.depth),
        np.array([K.fx, K.fy, K.cx, K.cy]),
        result,
    )
    return result


@compiled(error_model="numpy")
def _visibility(
    points: Array,
    normals: Array,
    poses: Array,
    X_CS: Array,
    depth: DepthImage,
    K: Array,
    result: Array,
) -> None:
    height, width = depth.shape
    X_CO = np.empty((3, 4))
    for m in range(len(poses)):
        X_SO = poses[m]
        for i in range(3):
            for j in range(4):
                X_CO[i, j] = X_CS[i, 3] if j == 3 else 0.0
                for k in range(3):
                    X_CO[i, j] += X_CS[i, k] * X_SO[k, j]
        confirmed, refuted = 0, 0
        for n in range(len(points)):
            x, y, z = points[n, 0], points[n, 1], points[n, 2]
            height_S = X_SO[2, 0] * x + X_SO[2, 1] * y + X_SO[2, 2] * z + X_SO[2, 3]
            if height_S < -_SUNK:
                refuted += 1
                continue
            px = X_CO[0, 0] * x + X_CO[0, 1] * y + X_CO[0, 2] * z + X_CO[0, 3]
            py = X_CO[1, 0] * x + X_CO[1, 1] * y + X_CO[1, 2] * z + X_CO[1, 3]
            pz = X_CO[2, 0] * x + X_CO[2, 1] * y + X_CO[2, 2] * z + X_CO[2, 3]
            if pz <= 0:
                refuted += 1
                continue
            a, b, c = normals[n, 0], normals[n, 1], normals[n, 2]
            facing = (
                px * (X_CO[0, 0] * a + X_CO[0, 1] * b + X_CO[0, 2] * c)
                + py * (X_CO[1, 0] * a + X_CO[1, 1] * b + X_CO[1, 2] * c)
                + pz * (X_CO[2, 0] * a + X_CO[2, 1] * b + X_CO[2, 2] * c)
            )
            if facing >= 0:
                continue
            u = math.floor(K[0] * px / pz + K[2] + 0.5)
            v = math.floor(K[1] * py / pz + K[3] + 0.5)
            if u < 0 or u >= width or v < 0 or v >= height:
                continue
            d = depth[v, u]
            if d == 0:
                continue
            if d > pz + _CLOSE:
                refuted += 1
            elif d > pz - _CLOSE:
                confirmed += 1
        result[m] = confirmed / max(confirmed + refuted, 1)
