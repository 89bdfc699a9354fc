# SPDX-License-Identifier: MIT
"""The prints of the six boxes.

Colours and kinds of goods follow the objects of the picking challenge; the drawings
are our own, with a different one on each side.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from physim_drake.models.apc11_drawing import (
    BLACK,
    BLUE,
    GREEN,
    RED,
    WHITE,
    YELLOW,
    Colour,
    Panel,
)


def crayons(panels: Mapping[str, Panel]) -> None:
    """A yellow and green box of wax crayons."""
    for name in panels:
        panels[name].fill(YELLOW)
    front = panels["+x"]
    _crayon_row(front, 0.42)
    front.rect(0, 0.62, 1, 0.80, GREEN)
    front.text(0.5, 0.71, "CRAYONS", 0.13, YELLOW)
    front.disc(0.8, 0.9, 0.075, RED)
    front.text(0.8, 0.9, "24", 0.09, WHITE)
    front.text(0.34, 0.9, "bright colours", 0.06, GREEN, width=0.55)
    back = panels["-x"]
    back.rect(0, 0, 1, 0.16, GREEN)
    back.text(0.5, 0.08, "24 WAX CRAYONS", 0.09, WHITE)
    for k in range(24):
        x, y = 0.09 + 0.165 * (k % 6 - 0.05), 0.26 + 0.10 * (k // 6)
        back.disc(x, y, 0.036, _hue(k / 24))
    back.small_print(0.07, 0.66, 0.93, 0.80, GREEN, lines=4, seed=1)
    back.barcode(0.5, 0.83, 0.93, 0.97, seed=1)
    for name, words in (("+z", "24 CRAYONS"), ("-z", "COLOUR YOUR DAY")):
        side = panels[name].turned()
        side.fill(YELLOW if name == "+z" else GREEN)
        side.rect(0, 0.8, 1, 1, GREEN if name == "+z" else YELLOW)
        side.text(0.5, 0.42, words, 0.5, GREEN if name == "+z" else YELLOW)
        panels[name].paste_turned(side)
    for k in range(8):
        panels["+y"].rect(0.25, 0.05 + 0.12 * k, 0.75, 0.12 + 0.12 * k, _hue(k / 8))
    panels["-y"].fill(GREEN)
    panels["-y"].small_print(0.05, 0.2, 0.6, 0.9, YELLOW, lines=3, seed=2)


def eraser(panels: Mapping[str, Panel]) -> None:
    """A blue and lime carton with a board eraser."""
    navy, lime = (24, 44, 112), (150, 200, 40)
    front = panels["+z"].turned()
    front.fill(navy)
    front.polygon([(0, 1), (0, 0.78), (0.55, 0.98), (1, 0.6), (1, 1)], lime)
    front.text(0.66, 0.22, "BOARD", 0.22, WHITE, width=0.6)
    front.text(0.66, 0.46, "ERASER", 0.2, lime, width=0.6)
    _felt_block(front)
    panels["+z"].paste_turned(front)
    back = panels["-z"].turned()
    back.fill((236, 238, 232))
    back.polygon([(0, 0), (1, 0), (1, 0.3), (0.5, 0.12), (0, 0.34)], lime)
    back.text(0.3, 0.5, "WIPES CLEAN", 0.13, navy, width=0.5)
    back.small_print(0.06, 0.62, 0.56, 0.94, navy, lines=6, seed=3)
    back.barcode(0.64, 0.5, 0.95, 0.92, seed=3)
    panels["-z"].paste_turned(back)
    for name, ground, words in (
        ("+x", lime, "dry erase care"),
        ("-x", (236, 238, 232), "1 erase  2 clean  3 polish"),
    ):
        side = panels[name].turned()
        side.fill(ground)
        side.rect(0, 0, 0.24, 1, navy)
        side.text(0.12, 0.5, "ERASER", 0.22, lime, width=0.2)
        side.text(0.62, 0.36, words, 0.26, navy, width=0.7)
        side.small_print(0.3, 0.62, 0.94, 0.92, navy, lines=3, seed=4)
        panels[name].paste_turned(side)
    panels["+y"].fill(navy)
    panels["+y"].text(0.5, 0.5, "ERASER", 0.36, WHITE)
    panels["-y"].fill(lime)
    for k in range(3):
        panels["-y"].rect(0.1 + 0.28 * k, 0.2, 0.32 + 0.28 * k, 0.8, navy, 0.1)
        panels["-y"].text(0.21 + 0.28 * k, 0.5, str(k + 1), 0.4, lime, width=0.2)


def book(panels: Mapping[str, Panel]) -> None:
    """A paperback of jokes: cover, back, spine and page edges."""
    cover, back = panels["+x"], panels["-x"]
    cover.fill((236, 66, 120))
    cover.star(0.5, 0.3, 0.27, YELLOW)
    for y, words in ((0.19, "LAUGH"), (0.3, "OUT"), (0.41, "LOUD")):
        cover.text(0.5, y, words, 0.105, BLUE, width=0.58)
    cover.rect(0, 0.58, 1, 0.68, BLUE)
    cover.text(0.5, 0.63, "JOKES FOR KIDS", 0.07, WHITE)
    for x, colour in (
        (0.2, (60, 200, 220)),
        (0.5, (120, 210, 60)),
        (0.8, (250, 150, 40)),
    ):
        _laughing_face(cover, x, 0.83, 0.085, colour)
    back.fill((60, 190, 214))
    back.text(0.5, 0.08, "KNOCK KNOCK!", 0.075, WHITE)
    for k, colour in enumerate(((255, 255, 250), (255, 236, 140), (255, 206, 226))):
        y, x = 0.16 + 0.19 * k, 0.05 + 0.08 * (k % 2)
        back.rect(x, y, x + 0.8, y + 0.14, colour, 0.03)
        back.polygon(
            [(x + 0.1, y + 0.13), (x + 0.2, y + 0.13), (x + 0.08, y + 0.17)], colour
        )
        back.small_print(
            x + 0.05, y + 0.03, x + 0.75, y + 0.12, BLUE, lines=3, seed=10 + k
        )
    back.rect(0, 0.76, 1, 1, (236, 66, 120))
    back.barcode(0.52, 0.8, 0.94, 0.96, seed=11)
    back.text(0.26, 0.88, "$3.99", 0.05, YELLOW, width=0.4)
    spine = panels["-z"].turned()
    spine.fill(BLUE)
    spine.text(0.4, 0.5, "LAUGH OUT LOUD", 0.6, YELLOW, width=0.6)
    spine.rect(0.86, 0, 1, 1, (236, 66, 120))
    panels["-z"].paste_turned(spine)
    for name in ("+z", "+y", "-y"):
        pages = panels[name].turned() if name == "+z" else panels[name]
        pages.fill((238, 230, 208))
        for k in range(5):
            pages.rect(0, 0.1 + 0.18 * k, 1, 0.15 + 0.18 * k, (212, 202, 176))
        pages.rect(0, 0, 1, 0.08, (236, 66, 120))
        if name == "+z":
            panels[name].paste_turned(pages)


def lightbulb(panels: Mapping[str, Panel]) -> None:
    """A carton of light bulbs, white above and blue below."""
    blue, warm = (20, 96, 176), (255, 222, 96)
    for name in ("+x", "-x", "+z", "-z"):
        panel = panels[name]
        panel.fill((246, 247, 248))
        panel.rect(0, 0.62, 1, 1, blue)
        panel.rect(0, 0.6, 1, 0.625, warm)
    for name, watts in (("+z", "60"), ("-z", "2x")):
        panel = panels[name]
        panel.text(0.5, 0.09, "SOFT WHITE", 0.075, blue)
        _bulb(panel, 0.5, 0.36, warm)
        panel.text(0.32, 0.78, watts, 0.17, WHITE, width=0.45)
        words = "WATT" if watts == "60" else "LIFE"
        panel.text(0.73, 0.8, words, 0.08, warm, width=0.4)
        panel.text(0.5, 0.93, "light bulbs", 0.06, WHITE, bold=False)
    facts, code = panels["+x"], panels["-x"]
    facts.facts(0.1, 0.05, 0.9, 0.56, "Lighting Facts", rows=7)
    facts.text(0.5, 0.74, "800 LUMEN", 0.09, warm)
    facts.text(0.5, 0.88, "2700 K", 0.07, WHITE)
    code.barcode(0.14, 0.06, 0.86, 0.26, seed=12)
    code.small_print(0.12, 0.32, 0.88, 0.56, (70, 70, 80), lines=7, seed=12)
    for k in range(4):
        code.disc(0.17 + 0.22 * k, 0.74, 0.05, warm)
    code.text(0.5, 0.89, "4 BULBS", 0.08, WHITE)
    panels["+y"].fill(blue)
    panels["+y"].text(0.5, 0.38, "60 W", 0.3, WHITE)
    panels["+y"].text(0.5, 0.7, "SOFT WHITE", 0.13, warm)
    panels["-y"].fill(warm)
    panels["-y"].text(0.5, 0.5, "E26", 0.3, blue)


def tissues(panels: Mapping[str, Panel]) -> None:
    """A near-cubic box of tissues with petals all over."""
    grounds = {
        "+x": (86, 172, 178),
        "-x": (96, 130, 190),
        "+z": (64, 150, 168),
        "-z": (120, 178, 160),
        "+y": (74, 160, 172),
        "-y": (226, 228, 226),
    }
    petals = ((244, 214, 120), (240, 240, 232), (226, 120, 140), (38, 92, 120))
    for k, (name, ground) in enumerate(grounds.items()):
        panels[name].fill(ground)
        if name != "-y":
            _petals(panels[name], petals, seed=20 + k)
    for name, words in (("+z", "TISSUES"), ("-z", "SOFT & STRONG")):
        panels[name].rect(0.12, 0.36, 0.88, 0.66, WHITE, 0.1)
        panels[name].text(0.5, 0.48, words, 0.13, (30, 84, 120), width=0.68)
        panels[name].text(0.5, 0.6, "3-ply  75 sheets", 0.06, (60, 150, 160), width=0.5)
    panels["+x"].disc(0.5, 0.5, 0.2, WHITE)
    panels["+x"].text(0.5, 0.47, "75", 0.18, (226, 96, 120), width=0.34)
    panels["+x"].text(0.5, 0.62, "tissues", 0.06, (30, 84, 120), width=0.3)
    top = panels["+y"]
    top.disc(0.5, 0.5, 0.3, WHITE)
    top.disc(0.5, 0.5, 0.27, (60, 84, 96))
    top.polygon(
        [(0.34, 0.6), (0.4, 0.38), (0.55, 0.3), (0.66, 0.46), (0.6, 0.66)], WHITE
    )
    top.polygon([(0.46, 0.62), (0.5, 0.4), (0.6, 0.5)], (214, 220, 224))
    base = panels["-y"]
    base.barcode(0.1, 0.12, 0.46, 0.42, seed=14)
    base.small_print(0.54, 0.14, 0.92, 0.44, (60, 84, 110), lines=6, seed=14)
    base.text(0.5, 0.62, "RECYCLE ME", 0.1, (40, 130, 90))
    base.small_print(0.1, 0.74, 0.9, 0.92, (60, 84, 110), lines=4, seed=15)


def soap(panels: Mapping[str, Panel]) -> None:
    """A white carton of soap with a blue wave and gold lettering."""
    blue, gold, pale = (30, 74, 150), (190, 150, 64), (226, 236, 246)
    for name in panels:
        panels[name].fill(WHITE)
    for name, words, wave in (
        ("+x", "beauty", pale),
        ("-x", "cream bar", (250, 226, 222)),
    ):
        panel = panels[name]
        x = np.linspace(0, 1, 40)
        crest = 0.7 - 0.16 * np.sin(2.6 * x + (0.4 if name == "+x" else 2.2))
        edge = list(zip(x.tolist(), crest.tolist(), strict=True))
        panel.polygon([(0, 1), *edge, (1, 1)], gold)
        panel.polygon([(a, b + 0.02) for a, b in edge] + [(1, 1), (0, 1)], wave)
        panel.text(0.46, 0.3, words, 0.26, blue, width=0.8)
        panel.text(0.3, 0.84, "1/4 moisture", 0.09, blue, width=0.5, bold=False)
    panels["+x"].disc(0.82, 0.74, 0.13, gold)
    panels["+x"].text(0.82, 0.74, "2", 0.16, WHITE, width=0.2)
    panels["-x"].rect(0.66, 0.74, 0.94, 0.94, blue, 0.04)
    panels["-x"].text(0.8, 0.84, "106 g", 0.1, WHITE, width=0.24)
    panels["+y"].rect(0, 0, 1, 0.25, blue)
    side = panels["+y"].turned()
    side.fill(blue)
    side.text(0.5, 0.4, "soap bar", 0.4, WHITE)
    side.rect(0, 0.8, 1, 0.86, gold)
    panels["+y"].paste_turned(side)
    under = panels["-y"].turned()
    under.fill(WHITE)
    under.barcode(0.05, 0.15, 0.4, 0.85, seed=16)
    under.small_print(0.46, 0.15, 0.95, 0.9, blue, lines=6, seed=16)
    panels["-y"].paste_turned(under)
    panels["+z"].fill(pale)
    panels["+z"].text(0.5, 0.3, "mild", 0.16, blue)
    panels["+z"].small_print(0.12, 0.5, 0.88, 0.9, blue, lines=6, seed=17)
    panels["-z"].fill(blue)
    panels["-z"].text(0.5, 0.5, "pH 7", 0.2, gold)


def _hue(share: float) -> Colour:
    """A strong colour; `share` runs once around the colour circle."""
    phase = 2 * np.pi * (share + np.array([0.0, 2.0, 1.0]) / 3)
    r, g, b = (128 + 108 * np.cos(phase)).round().astype(int)
    return int(r), int(g), int(b)


def _crayon_row(panel: Panel, tip: float) -> None:
    for k in range(6):
        x, colour = 0.06 + 0.148 * k, _hue(k / 6)
        top = 0.1 + 0.05 * (k % 2)
        panel.rect(x, top + 0.14, x + 0.12, 0.62, colour)
        panel.polygon(
            [
                (x, top + 0.14),
                (x + 0.045, top),
                (x + 0.075, top),
                (x + 0.12, top + 0.14),
            ],
            colour,
        )
        panel.rect(x, tip - 0.08, x + 0.12, tip - 0.06, BLACK)
        panel.rect(x, 0.54, x + 0.12, 0.56, BLACK)


def _felt_block(panel: Panel) -> None:
    panel.polygon([(0.05, 0.62), (0.12, 0.3), (0.36, 0.38), (0.3, 0.72)], (60, 62, 70))
    panel.polygon([(0.05, 0.62), (0.3, 0.72), (0.3, 0.86), (0.05, 0.76)], (34, 34, 40))
    panel.polygon([(0.3, 0.72), (0.36, 0.38), (0.36, 0.52), (0.3, 0.86)], (20, 20, 24))
    panel.rect(0.12, 0.5, 0.28, 0.54, (150, 200, 40))


def _laughing_face(panel: Panel, x: float, y: float, r: float, colour: Colour) -> None:
    aspect = panel.image.height / panel.image.width
    panel.disc(x, y, r, colour)
    for sign in (-1, 1):
        panel.disc(x + sign * 0.36 * r * aspect, y - 0.3 * r, 0.16 * r, BLACK)
    angle = np.linspace(0, np.pi, 20)
    mouth = [
        (
            float(x + 0.6 * r * aspect * np.cos(a)),
            float(y + 0.1 * r + 0.55 * r * np.sin(a)),
        )
        for a in angle
    ]
    panel.polygon(mouth, (150, 20, 40))


def _bulb(panel: Panel, x: float, y: float, colour: Colour) -> None:
    panel.star(x, y - 0.03, 0.2, (255, 244, 200), 18)
    panel.disc(x, y - 0.03, 0.125, colour)
    panel.polygon(
        [
            (x - 0.15, y + 0.03),
            (x + 0.15, y + 0.03),
            (x + 0.08, y + 0.14),
            (x - 0.08, y + 0.14),
        ],
        colour,
    )
    for k in range(3):
        panel.rect(
            x - 0.08,
            y + 0.145 + 0.025 * k,
            x + 0.08,
            y + 0.16 + 0.025 * k,
            (120, 124, 130),
        )


def _petals(panel: Panel, colours: tuple[Colour, ...], seed: int) -> None:
    rng = np.random.default_rng(seed)
    aspect = panel.image.height / panel.image.width
    for k in range(26):
        x, y = rng.uniform(0, 1, 2)
        size, start = rng.uniform(0.05, 0.11), rng.uniform(0, np.pi)
        for angle in start + 2 * np.pi * np.arange(5) / 5:
            panel.disc(
                float(x + 0.6 * size * aspect * np.cos(angle)),
                float(y + 0.6 * size * np.sin(angle)),
                0.42 * float(size),
                colours[k % len(colours)],
            )
        panel.disc(float(x), float(y), 0.25 * float(size), (250, 236, 190))
