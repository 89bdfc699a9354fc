# SPDX-License-Identifier: MIT
"""Random looks of scenes, in far more variety than a camera will ever see.

To a network that has learnt on scenes with any lights, surfaces and backgrounds, a real
image is one more of them (Tobin et al., "Domain Randomization", IROS 2017).
"""

from __future__ import annotations

import string
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from physim_drake.objects.containers import Container
from physim_drake.poses import Array
from physim_drake.rendering.appearance import Appearance, Light, Texture

_SIZE = 256  # px
_FONTS = (
    cv2.FONT_HERSHEY_SIMPLEX,
    cv2.FONT_HERSHEY_DUPLEX,
    cv2.FONT_HERSHEY_TRIPLEX,
    cv2.FONT_HERSHEY_SCRIPT_SIMPLEX,
)
Color = tuple[float, float, float]


class VividAppearance(Appearance):
    """An appearance whose textures have any colours and patterns."""

    def textures(self, container: Container) -> list[Texture]:
        """One texture for each box, half the time as muted as those of `Appearance`."""
        rng = np.random.default_rng(self.texture_seed)
        if rng.random() < 0.5:
            return super().textures(container)
        shared = draw_texture(rng), draw_texture(rng)
        wide = [bool(box.size[:2].min() > 1.0) for box in container.boxes]
        return [shared[0] if w else shared[1] for w in wide]


def draw_appearance(rng: np.random.Generator) -> VividAppearance:
    """One to three lamps anywhere above, with or without shadows, of any tint."""
    ambient = rng.uniform(0.15, 0.6)
    lights = [Light("directional", draw_tint(rng, 0.1), ambient, frame="camera")]
    count = int(rng.integers(1, 4))
    lights += [_draw_lamp(rng, 1.1 / count) for _ in range(count)]
    background = rng.uniform(0.0, 1.0) + rng.uniform(-0.2, 0.2, 3)
    red, green, blue = (float(x) for x in background.clip(0.0, 1.0))
    return VividAppearance(
        tuple(lights),
        bool(rng.random() < 0.7),
        (red, green, blue),
        int(rng.integers(2**31)),
    )


def draw_tint(rng: np.random.Generator, spread: float) -> Color:
    """The colour of a light, its brightest channel 1."""
    color = np.exp(spread * rng.standard_normal(3))
    red, green, blue = (float(x) for x in color / color.max())
    return red, green, blue


def draw_texture(rng: np.random.Generator, size: int = _SIZE) -> Texture:
    """A texture (size, size, 3) of one of several kinds in any colours."""
    kinds: tuple[Callable[[np.random.Generator, int], Array], ...] = (
        _plain,
        _clouds,
        _stripes,
        _tiles,
        _panels,
        _print,
    )
    return _bytes(kinds[int(rng.integers(len(kinds)))](rng, size))


def draw_print(rng: np.random.Generator, size: int = _SIZE) -> Texture:
    """A texture (size, size, 3) like that of a package: panels and letters."""
    return _bytes(_print(rng, size))


def _draw_lamp(rng: np.random.Generator, brightness: float) -> Light:
    azimuth, reach = rng.uniform(-np.pi, np.pi), rng.uniform(0.0, 1.5)
    p_WL = np.array(
        [reach * np.cos(azimuth), reach * np.sin(azimuth), rng.uniform(0.8, 2.5)]
    )
    aim = np.array([*rng.uniform(-0.3, 0.3, 2), 0.0]) - p_WL
    aim /= np.linalg.norm(aim)
    x, y, z = (float(v) for v in p_WL)
    u, v, w = (float(v) for v in aim)
    return Light(
        "spot",
        draw_tint(rng, 0.15),
        float(brightness * rng.uniform(0.4, 1.0)),
        (x, y, z),
        (u, v, w),
        cone_angle=float(rng.uniform(35.0, 75.0)),
    )


def _color(rng: np.random.Generator) -> Array:
    """A colour (3,), 0..255, half the time nearly grey."""
    level = rng.uniform(0, 255)
    spread = 12.0 if rng.random() < 0.5 else 80.0
    return np.asarray(np.clip(level + spread * rng.standard_normal(3), 0, 255))


def _plain(rng: np.random.Generator, size: int) -> Array:
    return _color(rng) + rng.uniform(0, 10) * _noise(rng, size, 16)[..., None]


def _clouds(rng: np.random.Generator, size: int) -> Array:
    """Two colours mixed by noise of several sizes."""
    cells = [int(2 ** rng.uniform(1, 7)) for _ in range(3)]
    share = sum((_noise(rng, size, n) for n in cells), np.zeros((size, size)))
    return _mix(rng, 1 / (1 + np.exp(-share * rng.uniform(0.5, 4.0))))


def _stripes(rng: np.random.Generator, size: int) -> Array:
    """Wavy lines in any direction, as of wood or cloth."""
    angle = rng.uniform(0, np.pi)
    y, x = np.mgrid[:size, :size] / size
    phase = x * np.cos(angle) + y * np.sin(angle)
    phase = phase * rng.uniform(2, 60) + rng.uniform(0, 1.5) * _noise(rng, size, 6)
    wave = np.sin(2 * np.pi * phase)
    return _mix(rng, 0.5 + 0.5 * (np.sign(wave) if rng.random() < 0.5 else wave))


def _tiles(rng: np.random.Generator, size: int) -> Array:
    """Squares of two colours, or of many."""
    cells = int(rng.integers(2, 24))
    index = np.arange(size) * cells // size
    if rng.random() < 0.5:
        return _mix(rng, np.asarray((index[:, None] + index) % 2, dtype=float))
    base, spread = _color(rng), rng.uniform(5, 70)
    grid = base + spread * rng.standard_normal((cells, cells, 3))
    return np.asarray(grid[index[:, None], index])


def _panels(rng: np.random.Generator, size: int) -> Array:
    """Shapes of any colours on top of each other."""
    image = np.empty((size, size, 3), np.uint8)
    image[:] = _color(rng)
    for _ in range(int(rng.integers(3, 25))):
        color = tuple(_color(rng))
        center = rng.integers(0, size, 2)
        if rng.random() < 0.5:
            reach = rng.integers(size // 20, size // 3, (int(rng.integers(3, 7)), 2))
            sign = rng.choice([-1, 1], reach.shape)
            cv2.fillPoly(image, [(center + sign * reach).astype(np.int32)], color)
        else:
            axes = rng.integers(size // 30, size // 4, 2)
            corner = (int(center[0]), int(center[1]))
            radii = (int(axes[0]), int(axes[1]))
            cv2.ellipse(image, corner, radii, rng.uniform(0, 180), 0, 360, color, -1)
    return image.astype(float)


def _print(rng: np.random.Generator, size: int) -> Array:
    """Panels with words."""
    image = np.ascontiguousarray(_panels(rng, size), dtype=np.uint8)
    letters = np.array(list(string.ascii_letters + string.digits))
    for _ in range(int(rng.integers(2, 9))):
        word = "".join(rng.choice(letters, int(rng.integers(1, 9))))
        place = (int(rng.integers(-size // 4, size)), int(rng.integers(0, size)))
        font = _FONTS[int(rng.integers(len(_FONTS)))]
        scale = float(size / 256 * np.exp(rng.uniform(-1.0, 1.2)))
        weight = int(rng.integers(1, 6))
        cv2.putText(image, word, place, font, scale, tuple(_color(rng)), weight)
    return image.astype(float)


def _mix(rng: np.random.Generator, share: Array) -> Array:
    """Two colours by their share (size, size), 0..1."""
    return np.asarray(
        share[..., None] * _color(rng) + (1 - share[..., None]) * _color(rng)
    )


def _noise(rng: np.random.Generator, size: int, cells: int) -> Array:
    """Smooth noise (size, size) of about unit variance from a grid of random values."""
    grid = rng.standard_normal((cells, cells))
    noise = cv2.resize(grid, (size, size), interpolation=cv2.INTER_CUBIC)
    return np.asarray(noise, np.float64)


def _bytes(image: Array) -> NDArray[np.uint8]:
    return np.clip(image, 0, 255).astype(np.uint8)
