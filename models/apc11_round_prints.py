# SPDX-License-Identifier: MIT
"""The prints of the can, the tape, the bottles and the ball.

Colours and kinds of goods follow the objects of the picking challenge; the drawings
are our own, with a different one on each side.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from PIL import Image
from scipy.spatial import KDTree

from physim_drake.models.apc11_drawing import BLACK, BLUE, WHITE, YELLOW, Panel


def coffee(panels: Mapping[str, Panel]) -> None:
    """A red plastic can with a black lid."""
    side, red, dark = panels["side"], (176, 22, 30), (132, 12, 22)
    side.fill(red)
    lid = 0.135
    side.rect(0, 0, 1, lid, (30, 28, 30))
    for k in range(90):
        side.rect(k / 90, 0.035, k / 90 + 0.004, lid - 0.02, (52, 50, 52))
    for left in (0.165, 0.665):
        for k in range(5):
            y = 0.36 + 0.11 * k
            side.rect(left, y, left + 0.17, y + 0.035, dark, 0.017)
    _coffee_label(side, 0.5)
    side.rect(0, 0.24, 0.13, 0.92, (92, 16, 24))
    side.rect(0.87, 0.24, 1, 0.92, (92, 16, 24))
    side.text(0.065, 0.33, "wake up", 0.07, YELLOW, width=0.11)
    side.small_print(0.015, 0.42, 0.12, 0.86, (236, 220, 200), lines=9, seed=5)
    side.text(0.935, 0.32, "GROUND", 0.06, WHITE, width=0.11)
    side.barcode(0.885, 0.42, 0.985, 0.66, seed=5)
    side.small_print(0.885, 0.72, 0.985, 0.88, YELLOW, lines=4, seed=6)
    for name, ground, ink in (("lid", (30, 28, 30), (70, 68, 70)), ("base", red, dark)):
        panel = panels[name]
        panel.fill(ground)
        for radius in (0.42, 0.30, 0.12):
            panel.disc(0.5, 0.5, radius, ink)
            panel.disc(0.5, 0.5, radius - 0.012, ground)
    panels["lid"].text(0.5, 0.31, "FRESH SEAL", 0.07, (120, 118, 120), width=0.5)
    panels["base"].small_print(0.35, 0.66, 0.65, 0.74, dark, lines=2, seed=7)


def tape(panels: Mapping[str, Panel]) -> None:
    """A roll of silver cloth tape on a cardboard core."""
    silver, weave, card = (152, 156, 160), (136, 140, 145), (196, 164, 120)
    outside = panels["outside"]
    outside.fill(silver)
    for k in range(120):
        outside.rect(k / 120, 0, k / 120 + 0.003, 1, weave)
    for k in range(16):
        outside.rect(0, k / 16, 1, k / 16 + 0.02, weave)
    outside.rect(0.93, 0, 0.935, 1, (90, 94, 98))
    outside.rect(0.4, 0.12, 0.6, 0.88, BLUE, 0.08)
    outside.text(0.5, 0.36, "CLOTH TAPE", 0.24, WHITE, width=0.18)
    outside.text(0.5, 0.68, "48 mm x 25 m", 0.18, YELLOW, width=0.17)
    inside = panels["inside"]
    inside.fill(card)
    for k in range(24):
        x = k / 24
        inside.polygon(
            [(x, 1), (x + 0.01, 1), (x + 0.05, 0), (x + 0.04, 0)], (178, 146, 104)
        )
    inside.rect(0.1, 0.2, 0.3, 0.8, (40, 120, 70))
    inside.rect(0.6, 0.2, 0.85, 0.8, WHITE)
    inside.small_print(0.62, 0.3, 0.83, 0.75, BLACK, lines=4, seed=8)
    for name, turns in (("top", (168, 172, 176)), ("bottom", (120, 124, 128))):
        panel = panels[name]
        panel.fill(silver)
        for k in range(12):
            panel.disc(0.5, 0.5, 0.5 - 0.0075 * k, turns if k % 2 else silver)
        panel.disc(0.5, 0.5, 0.418, card)


def glucose(panels: Mapping[str, Panel]) -> None:
    """A white bottle of tablets with a green and orange label."""
    side, green, orange = panels["side"], (88, 172, 52), (240, 136, 24)
    side.fill((240, 241, 238))
    for k in range(48):
        side.rect(k / 48, 0.03, k / 48 + 0.005, 0.135, (214, 216, 214))
    side.rect(0, 0.34, 1, 0.95, (252, 252, 250))
    side.rect(0, 0.34, 1, 0.37, green)
    side.rect(0.32, 0.37, 0.68, 0.95, (232, 244, 220))
    side.text(0.5, 0.43, "glucose tablets", 0.065, green, width=0.33)
    side.text(0.5, 0.5, "fast energy", 0.045, (70, 70, 70), width=0.3, bold=False)
    for x, y, r, colour in (
        (0.52, 0.66, 0.075, orange),
        (0.59, 0.7, 0.055, (214, 40, 60)),
        (0.625, 0.6, 0.05, (250, 214, 60)),
    ):
        side.disc(x, y, r, colour)
        side.disc(x - 0.008, y - 0.02, 0.25 * r, (255, 244, 214))
    side.polygon(
        [(0.34, 0.9), (0.34, 0.72), (0.40, 0.58), (0.46, 0.72), (0.46, 0.9)], green
    )
    side.text(0.4, 0.79, "50", 0.12, WHITE, width=0.1)
    side.text(0.57, 0.86, "orange flavour", 0.05, orange, width=0.2)
    side.facts(0.72, 0.39, 0.95, 0.93, "Nutrition Facts", rows=9)
    side.small_print(0.03, 0.41, 0.27, 0.66, (90, 90, 90), lines=8, seed=9)
    side.barcode(0.05, 0.7, 0.2, 0.92, seed=9)
    side.rect(0.22, 0.76, 0.29, 0.9, orange, 0.02)
    panels["cap"].fill((244, 245, 243))
    panels["cap"].disc(0.5, 0.5, 0.4, (226, 228, 226))
    panels["cap"].text(0.5, 0.42, "PUSH DOWN", 0.09, (150, 152, 150), width=0.6)
    panels["cap"].text(0.5, 0.58, "& TURN", 0.09, (150, 152, 150), width=0.5)
    panels["base"].fill((228, 229, 226))
    panels["base"].disc(0.5, 0.5, 0.36, (212, 213, 210))
    panels["base"].text(0.5, 0.5, "LOT 417", 0.08, (90, 90, 96), width=0.4)


def glue(panels: Mapping[str, Panel]) -> None:
    """A white flat bottle with an orange cap and a blue label."""
    side, orange, blue = panels["side"], (242, 104, 26), (24, 82, 168)
    side.fill((244, 244, 240))
    cap = 0.325
    side.rect(0, 0, 1, cap, orange)
    for k in range(48):
        side.rect(k / 48, 0.2, k / 48 + 0.006, cap - 0.01, (206, 82, 16))
    side.rect(0.31, 0.53, 0.69, 0.95, blue, 0.03)
    side.rect(0.31, 0.56, 0.69, 0.66, orange)
    side.text(0.5, 0.61, "WASHABLE", 0.06, WHITE, width=0.3)
    side.text(0.5, 0.735, "SCHOOL", 0.085, WHITE, width=0.33)
    side.text(0.5, 0.83, "GLUE", 0.09, YELLOW, width=0.33)
    side.text(0.5, 0.91, "no run  118 ml", 0.04, WHITE, width=0.3, bold=False)
    for left, right in ((0.0, 0.19), (0.81, 1.0)):
        side.rect(left, 0.53, right, 0.95, (214, 228, 244))
    side.text(0.095, 0.58, "DIRECTIONS", 0.04, blue, width=0.17)
    side.small_print(0.02, 0.63, 0.17, 0.92, blue, lines=9, seed=18)
    side.barcode(0.84, 0.57, 0.97, 0.76, seed=18)
    side.small_print(0.83, 0.8, 0.97, 0.93, blue, lines=4, seed=19)
    panels["tip"].fill(orange)
    panels["base"].fill((226, 226, 222))
    panels["base"].text(0.5, 0.5, "118 ml", 0.1, (120, 120, 120), width=0.5)


def baseball(panels: Mapping[str, Panel]) -> None:
    """White leather with red stitches, found from the seam's curve on the sphere."""
    skin = panels["skin"]
    width, height = skin.image.size
    azimuth = (np.arange(width) + 0.5) / width * 2 * np.pi - np.pi
    latitude = np.pi / 2 - (np.arange(height) + 0.5) / height * np.pi
    lat, azi = np.meshgrid(latitude, azimuth, indexing="ij")
    directions = np.stack(
        [np.cos(lat) * np.sin(azi), np.sin(lat), np.cos(lat) * np.cos(azi)], axis=-1
    )
    turn = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    curve = _seam(turn)
    distance, nearest = KDTree(curve).query(directions)
    along = nearest / len(turn) * 108
    stitch = ((along + 6 * distance) % 1 < 0.42) & (distance < 0.11)
    pixels = np.full((height, width, 3), (240, 238, 230), dtype=np.uint8)
    pixels[stitch] = (190, 24, 36)
    pixels[distance < 0.014] = (168, 160, 150)
    skin.image.paste(Image.fromarray(pixels))
    skin.text(0.37, 0.45, "LEAGUE BALL", 0.06, BLUE, width=0.14)
    skin.text(0.37, 0.53, "No. 9", 0.055, BLUE, width=0.1)


def _coffee_label(panel: Panel, x: float) -> None:
    panel.rect(x - 0.15, 0.2, x + 0.15, 0.96, (40, 36, 78), 0.06)
    panel.star(x, 0.42, 0.2, (246, 150, 30), 20)
    panel.disc(x, 0.42, 0.12, YELLOW)
    panel.rect(x - 0.15, 0.5, x + 0.15, 0.72, (186, 22, 30))
    panel.text(x, 0.61, "COFFEE", 0.17, WHITE, width=0.28)
    panel.text(x, 0.79, "CLASSIC ROAST", 0.075, YELLOW, width=0.26)
    panel.text(x, 0.89, "medium  320 g", 0.05, WHITE, width=0.22, bold=False)


def _seam(
    turn: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Points (N, 3) of a baseball's seam on the unit sphere at parameters (N,), rad."""
    a, b = 0.72, 0.28
    return np.stack(
        [
            a * np.cos(turn) + b * np.cos(3 * turn),
            2 * np.sqrt(a * b) * np.sin(2 * turn),
            a * np.sin(turn) - b * np.sin(3 * turn),
        ],
        axis=-1,
    )
