# SPDX-License-Identifier: MIT
"""Depth as a stereo or coded-light camera measures it.

Noise lives in disparity d = f B / z, so that its effect on depth grows with z^2:
sigma_z = z^2 s / (f B) for a disparity error of s pixels (A. Grunnet-Jepsen et al.,
"Best-known-methods for tuning Intel RealSense D400 depth cameras"). Every effect has a
field of `DepthNoise`, and zero switches it off.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import ndtr

from physim_drake.camera import CameraIntrinsics, DepthImage
from physim_drake.observation.observation import Mask
from physim_drake.poses import Array, make_pose

_BLUR = 1.5  # px, of what holes on a surface look like
_JITTER_WIDTH = 1.5  # px, along which an edge is moved alike
_FAR = 1e6  # m, for pixels in which nothing is seen


@dataclass(frozen=True)
class DepthNoise:
    """The errors of a depth camera.

    Attributes:
        focal_length: focal length of the depth sensor, px. With the baseline it sets
            disparities.
        baseline: distance between its two viewpoints, m.
        disparity_error: root mean square error of the disparity, px.
        correlation: distance over which errors are alike, px.
        disparity_step: quantum of the disparity, px.
        depth_unit: quantum of the depth image, m.
        min_range: least depth that is measured, m.
        max_range: largest depth that is measured, m.
        edge_step: difference of neighbouring depths, as a share of z, that makes an
            edge.
        edge_jitter: how far edges are moved, root mean square, px.
        edge_loss: share of the pixels at an edge that are lost.
        grazing_cosine: cosine between normal and ray below which a surface is lost.
            Up to twice that it is lost in part.
        dark_loss: share of pixels lost on surfaces darker than `dark_level`.
        dark_level: brightness by a lamp at the camera, 0..255.
        shiny_loss: share of pixels lost if brightness exceeds `shiny_level`.
        shiny_level: brightness that blinds the sensor, 0..255.
        shadow_side: side of the second viewpoint. What it cannot see is lost. 1 is the
            right, whose shadows lie left of near objects, -1 the left, and 0 means no
            shadow.
        extrinsic_angle: error of the depth sensor's orientation to colour, rad, root
            mean square about each axis.
        extrinsic_shift: error of its position, m, along each axis.
    """

    focal_length: float = 665.0
    baseline: float = 0.055
    disparity_error: float = 0.08
    correlation: float = 2.5
    disparity_step: float = 1.0 / 32.0
    depth_unit: float = 1e-4
    min_range: float = 0.29
    max_range: float = 10.0
    edge_step: float = 0.015
    edge_jitter: float = 0.7
    edge_loss: float = 0.3
    grazing_cosine: float = 0.15
    dark_loss: float = 0.2
    dark_level: float = 16.0
    shiny_loss: float = 0.15
    shiny_level: float = 252.0
    shadow_side: int = 1
    extrinsic_angle: float = 5e-4
    extrinsic_shift: float = 2e-4

    @classmethod
    def none(cls) -> DepthNoise:
        """A perfect camera."""
        return cls(
            disparity_error=0.0,
            disparity_step=0.0,
            depth_unit=0.0,
            min_range=0.0,
            max_range=np.inf,
            edge_jitter=0.0,
            edge_loss=0.0,
            grazing_cosine=0.0,
            dark_loss=0.0,
            shiny_loss=0.0,
            shadow_side=0,
            extrinsic_angle=0.0,
            extrinsic_shift=0.0,
        )

    def without_holes(self) -> DepthNoise:
        """The same camera, whose only errors are those of the disparity."""
        return replace(
            DepthNoise.none(),
            focal_length=self.focal_length,
            baseline=self.baseline,
            disparity_error=self.disparity_error,
            correlation=self.correlation,
            disparity_step=self.disparity_step,
        )

    def sigma(self, z: Array) -> Array:
        """Standard deviation (m) of depth at distances `z` (m), z^2 s / (f B)."""
        return np.asarray(
            np.square(z) * self.disparity_error / (self.focal_length * self.baseline)
        )

    def draw_extrinsic_error(self, rng: np.random.Generator) -> Array:
        """X_CD (4, 4), the true pose of the depth sensor D, which should be at C."""
        R = Rotation.from_rotvec(rng.normal(0.0, 1.0, 3) * self.extrinsic_angle)
        return make_pose(R.as_matrix(), rng.normal(0.0, 1.0, 3) * self.extrinsic_shift)


def measure_depth(
    depth: DepthImage,
    intrinsics: CameraIntrinsics,
    noise: DepthNoise,
    rng: np.random.Generator,
    echo: NDArray[np.uint8] | None = None,
) -> DepthImage:
    """What a camera makes of true depth.

    Args:
        depth: true z, (height, width), m, 0 if nothing is seen.
        intrinsics: intrinsics of the image.
        noise: errors of the camera. The extrinsic error is not applied here, since it
            moves the viewpoint that `depth` is rendered from.
        rng: source of the errors.
        echo: (height, width, 3) RGB by a lamp at the camera, which shows dark and
            shiny surfaces. Without it these lose nothing.

    Returns:
        (height, width) float32, m, 0 if nothing was measured.
    """
    z = np.where(depth > 0, depth, _FAR).astype(float)
    edge = _edges(z, noise)
    lost = _shadow(z, intrinsics, noise) | _grazing(z, edge, intrinsics, noise, rng)
    lost |= _bad_surface(echo, z.shape, noise, rng)
    z = _jitter_edges(z, edge, noise, rng)
    lost |= edge & (_patches(z.shape, rng) < noise.edge_loss)
    lost |= (z < noise.min_range) | (z > noise.max_range) | (z >= _FAR / 2)
    z = _disturb(z, noise, rng)
    if noise.depth_unit:
        z = np.round(z / noise.depth_unit) * noise.depth_unit
    return np.where(lost, 0.0, np.maximum(z, 0.0)).astype(np.float32)


def _disturb(z: Array, noise: DepthNoise, rng: np.random.Generator) -> Array:
    """Adds correlated noise to the disparity and quantises it."""
    scale = noise.focal_length * noise.baseline
    disparity = scale / z
    error = _smooth_noise(z.shape, noise.correlation, rng)
    disparity = disparity + noise.disparity_error * error
    if noise.disparity_step:
        disparity = np.round(disparity / noise.disparity_step) * noise.disparity_step
    return np.asarray(scale / np.maximum(disparity, scale / _FAR))


def _shadow(z: Array, intrinsics: CameraIntrinsics, noise: DepthNoise) -> Mask:
    """Pixels that the second viewpoint cannot see.

    Seen from a second camera on the right, column u lands on u - d. Something nearer
    that starts right of it and lands left of it hides it.
    """
    if noise.shadow_side == 0:
        return np.zeros(z.shape, dtype=bool)
    flip = slice(None, None, noise.shadow_side)
    # In pixels of this image, whose focal length need not be the sensor's.
    disparity = intrinsics.fx * noise.baseline / z[:, flip]
    landing = np.arange(z.shape[1]) - disparity
    nearest = np.minimum.accumulate(landing[:, ::-1], axis=1)[:, ::-1]
    hidden = np.zeros(z.shape, dtype=bool)
    hidden[:, :-1] = landing[:, :-1] > nearest[:, 1:]
    return hidden[:, flip]


def _grazing(
    z: Array,
    edge: Mask,
    intrinsics: CameraIntrinsics,
    noise: DepthNoise,
    rng: np.random.Generator,
) -> Mask:
    """Pixels on surfaces that are seen too flat.

    The normal of z(u, v) = 1 / w(u, v) in pixels: the plane n . p = 1 has n . ray = w,
    so that n_x = fx dw/du, n_y = fy dw/dv, and n . ray = w gives n_z.
    """
    patches = _patches(z.shape, rng)
    if noise.grazing_cosine == 0:
        return np.zeros(z.shape, dtype=bool)
    w = 1.0 / z
    n_x = intrinsics.fx * np.gradient(w, axis=1)
    n_y = intrinsics.fy * np.gradient(w, axis=0)
    x = (np.arange(z.shape[1]) - intrinsics.cx) / intrinsics.fx
    y = ((np.arange(z.shape[0]) - intrinsics.cy) / intrinsics.fy)[:, None]
    n_z = w - n_x * x - n_y * y
    normal = np.sqrt(n_x**2 + n_y**2 + n_z**2)
    cosine = w / (normal * np.sqrt(x**2 + y**2 + 1.0))
    limit = noise.grazing_cosine * (1.0 + patches)
    # The gradient across an edge is not a surface's, and edges have their own loss.
    return np.asarray((cosine < limit) & ~edge & (z < _FAR / 2))


def _bad_surface(
    echo: NDArray[np.uint8] | None,
    shape: tuple[int, ...],
    noise: DepthNoise,
    rng: np.random.Generator,
) -> Mask:
    """Pixels on surfaces that reflect too little or too much."""
    patches = _patches(shape, rng)
    if echo is None:
        return np.zeros(shape, dtype=bool)
    level = echo.max(axis=2)
    dark = (level < noise.dark_level) & (patches < noise.dark_loss)
    shiny = (echo.min(axis=2) > noise.shiny_level) & (patches < noise.shiny_loss)
    return np.asarray(dark | shiny)


def _edges(z: Array, noise: DepthNoise) -> Mask:
    """Pixels whose neighbourhood holds a step in depth."""
    image = z.astype(np.float32)
    kernel = np.ones((3, 3), np.uint8)
    step = cv2.dilate(image, kernel) - cv2.erode(image, kernel)
    # A plane seen flat also changes within three pixels, but on both sides.
    bend = np.abs(cv2.Laplacian(image, cv2.CV_32F, ksize=1))
    limit = noise.edge_step * image
    return np.asarray((step > limit) & (bend > 0.25 * limit))


def _jitter_edges(
    z: Array, edge: Mask, noise: DepthNoise, rng: np.random.Generator
) -> Array:
    """Takes each pixel from a place a little beside it, which frays the edges."""
    shift = [_smooth_noise(z.shape, _JITTER_WIDTH, rng) for _ in range(2)]
    if noise.edge_jitter == 0:
        return z
    # Beside edges this would only add noise, which has its own law.
    near_edge = cv2.dilate(edge.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    here = np.nonzero(near_edge)
    there = [
        np.clip(np.round(index + noise.edge_jitter * shift[k][here]), 0, size - 1)
        for k, (index, size) in enumerate(zip(here, z.shape, strict=True))
    ]
    moved = z.copy()
    moved[here] = z[there[0].astype(int), there[1].astype(int)]
    return moved


def _patches(shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Uniform numbers 0..1 (height, width) that are alike in small patches."""
    return np.asarray(ndtr(_smooth_noise(shape, _BLUR, rng)), dtype=float)


def _smooth_noise(
    shape: tuple[int, ...], width: float, rng: np.random.Generator
) -> Array:
    """Normal numbers (height, width) of unit variance, alike within `width` px."""
    white = rng.standard_normal(shape, dtype=np.float32)
    size = 2 * round(4 * width) + 1
    kernel = cv2.getGaussianKernel(size, max(width, 1e-3))
    smooth = cv2.sepFilter2D(white, cv2.CV_32F, kernel, kernel)
    return np.asarray(smooth, dtype=float) / float(np.square(kernel).sum())
