# SPDX-License-Identifier: MIT
"""The pinhole camera: intrinsics, and depth images to points and back.

Camera frame C: x right, y down, z forward, as OpenCV, BOP and Drake have it. A depth
image holds z in metres, and 0 where nothing was measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physim_drake.errors import InputError
from physim_drake.poses import Array

DepthImage = NDArray[np.float32]


@dataclass(frozen=True)
class CameraIntrinsics:
    """A pinhole camera without distortion; lengths in pixels.

    Pixel (u, v) has its centre at integer coordinates, as in OpenCV.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    @classmethod
    def from_matrix(cls, K: Array, width: int, height: int) -> CameraIntrinsics:
        """Reads the (3, 3) matrix `K`.

        Raises:
            InputError: if it has another shape, or skews the image.
        """
        K = np.asarray(K, dtype=float)
        if K.shape != (3, 3):
            raise InputError(
                "camera matrix", f"has shape {K.shape}", "give fx, fy, cx, cy as 3 x 3"
            )
        if abs(K[0, 1]) > 1e-6 * abs(K[0, 0]):
            raise InputError(
                "camera matrix",
                f"has a skew of {K[0, 1]:g}",
                "rectify the images, so that it is 0",
            )
        return cls(
            int(width),
            int(height),
            float(K[0, 0]),
            float(K[1, 1]),
            float(K[0, 2]),
            float(K[1, 2]),
        )

    @property
    def K(self) -> Array:
        """The (3, 3) camera matrix."""
        return np.array(
            [[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]]
        )

    def rays(self) -> Array:
        """Directions (height, width, 3) in C with z = 1, one a pixel."""
        u = (np.arange(self.width) - self.cx) / self.fx
        v = (np.arange(self.height) - self.cy) / self.fy
        rays = np.ones((self.height, self.width, 3))
        rays[..., 0] = u[None, :]
        rays[..., 1] = v[:, None]
        return rays

    def unproject(self, depth: DepthImage) -> Array:
        """Points p_C (height, width, 3), m, of a depth image; 0 where it is 0."""
        return np.asarray(self.rays() * depth[..., None].astype(float))

    def project(self, p_C: Array) -> Array:
        """Pixel coordinates (..., 2) of points (..., 3) in front of the camera."""
        z = np.maximum(p_C[..., 2], 1e-6)
        return np.stack(
            [
                self.fx * p_C[..., 0] / z + self.cx,
                self.fy * p_C[..., 1] / z + self.cy,
            ],
            axis=-1,
        )
