# SPDX-License-Identifier: MIT
"""What cameras make of colours, over a range wider than that of any one camera."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

FloatImage = NDArray[np.float32]


@dataclass(frozen=True)
class PhotometryConfig:
    """How much colours are changed.

    Attributes:
        gain: root mean square of the logarithm of the exposure.
        offset: root mean square, levels of 255.
        gamma: root mean square of its logarithm.
        white_balance: root mean square of the logarithm of each channel's gain.
        saturation: range of the factor.
        hue: largest turn of the hues, degrees.
        blur: how often the image is out of focus or in motion.
        max_blur: largest blur, px.
        sharpen: how often a camera's sharpening is overdone.
        noise: largest root mean square, levels.
        grain: how often noise is smooth, as after a camera's noise filter.
        compress: how often it is stored as JPEG.
    """

    gain: float = 0.3
    offset: float = 12.0
    gamma: float = 0.2
    white_balance: float = 0.1
    saturation: tuple[float, float] = (0.5, 1.5)
    hue: float = 9.0
    blur: float = 0.4
    max_blur: float = 2.2
    sharpen: float = 0.15
    noise: float = 12.0
    grain: float = 0.3
    compress: float = 0.2

    def calmed(self) -> PhotometryConfig:
        """The same with changes of half the size."""
        low, high = self.saturation
        return PhotometryConfig(
            gain=self.gain / 2,
            offset=self.offset / 2,
            gamma=self.gamma / 2,
            white_balance=self.white_balance / 2,
            saturation=((1 + low) / 2, (1 + high) / 2),
            hue=self.hue / 2,
            blur=self.blur / 2,
            max_blur=max(self.max_blur / 2, 0.4),
            sharpen=self.sharpen / 2,
            noise=self.noise / 2,
            grain=self.grain / 2,
            compress=self.compress / 2,
        )


def take_photo(
    color: NDArray[np.uint8], config: PhotometryConfig, rng: np.random.Generator
) -> FloatImage:
    """An image (height, width, 3) as some camera takes it, 0..255."""
    image = _tone(color.astype(np.float32), config, rng)
    image = _saturate(image, config, rng)
    if rng.random() < config.blur:
        image = _blurred(image, rng.uniform(0.4, config.max_blur), rng)
    elif rng.random() < config.sharpen:
        soft = np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0), np.float32)
        sharp = image + np.float32(rng.uniform(0.3, 1.2)) * (image - soft)
        image = np.asarray(sharp, np.float32)
    image = _noisy(image, config, rng)
    image = np.clip(image, 0, 255).astype(np.float32)
    if rng.random() < config.compress:
        quality = int(rng.integers(30, 90))
        _, data = cv2.imencode(
            ".jpg", image.astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, quality]
        )
        image = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.float32)
    return image


def _tone(
    image: FloatImage, config: PhotometryConfig, rng: np.random.Generator
) -> FloatImage:
    """Exposure, white balance, gamma, offset: one table a channel."""
    gain = np.exp(config.gain * rng.standard_normal())
    balance = np.exp(config.white_balance * rng.standard_normal(3))
    gamma = np.exp(config.gamma * rng.standard_normal())
    offset = config.offset * rng.standard_normal()
    levels = np.arange(256)[:, None] / 255.0
    table = 255.0 * gain * balance * levels**gamma + offset
    tables = np.clip(table, 0, 255).astype(np.float32)
    toned = cv2.LUT(image.astype(np.uint8), tables[:, None, :].copy())
    return np.asarray(toned, np.float32)


def _saturate(
    image: FloatImage, config: PhotometryConfig, rng: np.random.Generator
) -> FloatImage:
    """Turns and stretches colours about the grey axis: one 3 x 3 matrix."""
    angle = np.deg2rad(rng.uniform(-config.hue, config.hue))
    factor = rng.uniform(*config.saturation)
    grey = np.full((3, 3), 1.0 / 3)
    across = np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]]) / np.sqrt(3)
    about = np.cos(angle) * (np.eye(3) - grey) + np.sin(angle) * across
    return np.asarray(cv2.transform(image, grey + factor * about), np.float32)


def _blurred(image: FloatImage, blur: float, rng: np.random.Generator) -> FloatImage:
    """Out of focus, or moved while it was taken."""
    if rng.random() < 0.6:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), blur), np.float32)
    length = int(np.ceil(2 * blur)) | 1
    angle = rng.uniform(0, np.pi)
    kernel = np.zeros((length, length), np.float32)
    middle = length // 2
    step = middle * np.array([np.cos(angle), np.sin(angle)])
    start, end = (tuple(round(float(middle + s * x)) for x in step) for s in (-1, 1))
    cv2.line(kernel, start, end, 1.0)
    return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum()), np.float32)


def _noisy(
    image: FloatImage, config: PhotometryConfig, rng: np.random.Generator
) -> FloatImage:
    spread = config.noise * rng.random() ** 2
    noise = rng.standard_normal(image.shape, dtype=np.float32)
    if rng.random() < config.grain:
        noise = 2.0 * cv2.GaussianBlur(noise, (0, 0), 0.8)
    return np.asarray(image + np.float32(spread) * noise, np.float32)
