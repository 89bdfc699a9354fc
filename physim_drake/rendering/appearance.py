# SPDX-License-Identifier: MIT
"""How a scene looks: random lights, and procedural textures for its container."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physim_drake.objects.containers import Container
from physim_drake.poses import Array

Texture = NDArray[np.uint8]
"""RGB image, (height, width, 3)."""

_SIZE = 512  # px


@dataclass(frozen=True)
class Light:
    """A light, in the terms of Drake's `LightParameter`.

    Attributes:
        kind: "point", "spot" or "directional".
        color: RGB, 0..1.
        intensity: brightness; 1 fully lights a surface that faces the light.
        position: position in its frame, (3,), m.
        direction: direction of the light in its frame, (3,).
        frame: "world" or "camera".
        cone_angle: angle between the axis and the rim of a spot, degrees.
    """

    kind: str
    color: tuple[float, float, float]
    intensity: float
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    direction: tuple[float, float, float] = (0.0, 0.0, 1.0)
    frame: str = "world"
    cone_angle: float = 45.0


@dataclass(frozen=True)
class Appearance:
    """Lights and surfaces of a scene.

    Attributes:
        lights: lights, at least one.
        shadows: whether the lights cast shadows.
        background: RGB of pixels that show nothing, 0..1.
        texture_seed: seed of the container's textures.
    """

    lights: tuple[Light, ...]
    shadows: bool = True
    background: tuple[float, float, float] = (0.3, 0.4, 0.45)
    texture_seed: int = 0

    @classmethod
    def plain(cls) -> Appearance:
        """A lamp at the camera, no shadows: every part is lit."""
        return cls((Light("directional", (1.0, 1.0, 1.0), 1.0, frame="camera"),), False)

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Appearance:
        """A lamp above with a shadow, and soft light from the camera's side."""
        warmth = rng.uniform(-0.12, 0.12)
        color = (1.0 - max(-warmth, 0.0), 1.0 - abs(warmth) / 2, 1.0 - max(warmth, 0.0))
        p_WL = np.array([*rng.uniform(-0.9, 0.9, 2), rng.uniform(1.2, 2.0)])
        aim = np.array([*rng.uniform(-0.1, 0.1, 2), 0.0]) - p_WL
        fill = rng.uniform(0.35, 0.6)
        return cls(
            (
                Light(
                    "spot",
                    color,
                    float(rng.uniform(0.5, 0.85)),
                    _triple(p_WL),
                    _triple(aim / np.linalg.norm(aim)),
                    cone_angle=float(rng.uniform(45.0, 60.0)),
                ),
                Light("directional", (1.0, 1.0, 1.0), float(fill), frame="camera"),
            ),
            True,
            _triple(rng.uniform(0.2, 0.5) + rng.uniform(-0.06, 0.06, 3)),
            int(rng.integers(2**31)),
        )

    def textures(self, container: Container) -> list[Texture]:
        """One texture for each box; the walls of a container share theirs."""
        rng = np.random.default_rng(self.texture_seed)
        wide = [bool(box.size[:2].min() > 1.0) for box in container.boxes]
        table, walls = _draw_texture(rng), _draw_texture(rng)
        return [table if w else walls for w in wide]


def _draw_texture(rng: np.random.Generator) -> Texture:
    """One of several kinds of surface in random muted colours."""
    kinds = (_plain, _grain, _checks, _speckles)
    base = rng.uniform(80, 200) + rng.uniform(-25, 25, 3)
    return kinds[int(rng.integers(len(kinds)))](rng, base)


def _plain(rng: np.random.Generator, base: Array) -> Texture:
    return _tint(_noise(rng, (24, 24)), base, 8.0)


def _grain(rng: np.random.Generator, base: Array) -> Texture:
    """Streaks, as of wood."""
    streaks = _noise(rng, (128, 6)) + 0.5 * _noise(rng, (256, 12))
    return _tint(streaks, base, rng.uniform(8.0, 20.0))


def _checks(rng: np.random.Generator, base: Array) -> Texture:
    """Squares, as of a table cloth or tiles."""
    cells = int(rng.integers(8, 30))
    index = np.arange(_SIZE) * cells // _SIZE
    checks = ((index[:, None] + index) % 2) * 2.0 - 1.0
    return _tint(np.asarray(checks, dtype=float), base, rng.uniform(6.0, 30.0))


def _speckles(rng: np.random.Generator, base: Array) -> Texture:
    """Grains, as of stone."""
    return _tint(_noise(rng, (_SIZE, _SIZE)), base, rng.uniform(6.0, 15.0))


def _noise(rng: np.random.Generator, cells: tuple[int, int]) -> Array:
    """Smooth noise (size, size) of unit variance from a grid of random values."""
    grid = rng.standard_normal(cells)
    noise = cv2.resize(grid, (_SIZE, _SIZE), interpolation=cv2.INTER_CUBIC)
    return np.asarray(noise, np.float64)


def _tint(pattern: Array, base: Array, contrast: float) -> Texture:
    return np.clip(base + contrast * pattern[..., None], 0, 255).astype(np.uint8)


def _triple(values: Array) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z
