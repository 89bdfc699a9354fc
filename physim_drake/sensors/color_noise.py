# SPDX-License-Identifier: MIT
"""Colour as a small sensor with automatic exposure takes it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class ColorNoise:
    """The errors of a colour camera.

    Attributes:
        exposure: range of mean brightness that its automatic exposure reaches, 0..255.
        max_gain: factor by which it brightens or darkens an image at most.
        white_balance: error of the red and the blue gain, root mean square.
        shot_noise: variance per level of brightness.
        read_noise: root mean square error, levels.
        blur: blur of the lens, px.
    """

    exposure: tuple[float, float] = (85.0, 135.0)
    max_gain: float = 2.5
    white_balance: float = 0.03
    shot_noise: float = 0.03
    read_noise: float = 1.2
    blur: float = 0.5


def expose(
    color: NDArray[np.uint8], noise: ColorNoise, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """What a camera makes of an ideal image, (height, width, 3) RGB."""
    image = color.astype(np.float32)
    target = rng.uniform(*noise.exposure)
    gain = target / max(float(image.mean()), 1.0)
    image *= np.clip(gain, 1 / noise.max_gain, noise.max_gain)
    image[..., [0, 2]] *= 1.0 + noise.white_balance * rng.standard_normal(2)
    if noise.blur:
        image = cv2.GaussianBlur(image, (0, 0), noise.blur).astype(np.float32)
    spread = np.sqrt(noise.shot_noise * np.maximum(image, 0) + noise.read_noise**2)
    image += spread * rng.standard_normal(image.shape, dtype=np.float32)
    return np.clip(np.round(image), 0, 255).astype(np.uint8)
