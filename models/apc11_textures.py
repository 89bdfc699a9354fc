# SPDX-License-Identifier: MIT
"""The prints of the eleven objects; each side has its own picture.

Colours and kinds of goods follow the objects of the picking challenge; the drawings
are our own.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from physim_drake.models.apc11_drawing import Colour, Panel
from PIL import Image
from scipy.spatial import KDTree

_WHITE, _BLACK = (248, 248, 246), (24, 24, 26)
_YELLOW, _GREEN, _RED, _BLUE = (
    (250, 202, 30),
    (0, 122, 76),
    (198, 30, 38),
    (22, 58, 140),
)

Panels = Mapping[str, Panel]


def crayons(panels: Panels) -> None:
    """A yellow and green box of wax crayons."""
    for name in panels:
        panels[name].fill(_YELLOW)
    front = panels["+x"]
    _crayon_row(front, 0.42)
    front.rect(0, 0.62, 1, 0.80, _GREEN)
    front.text(0.5, 0.71, "CRAYONS", 0.13, _YELLOW)
    front.disc(0.8, 0.9, 0.075, _RED)
    front.text(0.8, 0.9, "24", 0.09, _WHITE)
    front.text(0.34, 0.9, "bright colours", 0.06, _GREEN, width=0.55)
    back = panels["-x"]
    back.rect(0, 0, 1, 0.16, _GREEN)
    back.text(0.5, 0.08, "24 WAX CRAYONS", 0.09, _WHITE)
    for k in range(24):
        x, y = 0.09 + 0.165 * (k % 6 - 0.05), 0.26 + 0.10 * (k // 6)
        back.disc(x, y, 0.036, _hue(k / 24))
    back.small_print(0.07, 0.66, 0.93, 0.80, _GREEN, lines=4, seed=1)
    back.barcode(0.5, 0.83, 0.93, 0.97, seed=1)
    for name, words in (("+z", "24 CRAYONS"), ("-z", "COLOUR YOUR DAY")):
        side = panels[name].turned()
        side.fill(_YELLOW if name == "+z" else _GREEN)
        side.rect(0, 0.8, 1, 1, _GREEN if name == "+z" else _YELLOW)
        side.text(0.5, 0.42, words, 0.5, _GREEN if name == "+z" else _YELLOW)
        panels[name].paste_turned(side)
    for k in range(8):
        panels["+y"].rect(0.25, 0.05 + 0.12 * k, 0.75, 0.12 + 0.12 * k, _hue(k / 8))
    panels["-y"].fill(_GREEN)
    panels["-y"].small_print(0.05, 0.2, 0.6, 0.9, _YELLOW, lines=3, seed=2)


def eraser(panels: Panels) -> None:
    """A blue and lime carton with a board eraser."""
    navy, lime = (24, 44, 112), (150, 200, 40)
    front = panels["+z"].turned()
    front.fill(navy)
    front.polygon([(0, 1), (0, 0.78), (0.55, 0.98), (1, 0.6), (1, 1)], lime)
    front.text(0.66, 0.22, "BOARD", 0.22, _WHITE, width=0.6)
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
    panels["+y"].text(0.5, 0.5, "ERASER", 0.36, _WHITE)
    panels["-y"].fill(lime)
    for k in range(3):
        panels["-y"].rect(0.1 + 0.28 * k, 0.2, 0.32 + 0.28 * k, 0.8, navy, 0.1)
        panels["-y"].text(0.21 + 0.28 * k, 0.5, str(k + 1), 0.4, lime, width=0.2)


def coffee(panels: Panels) -> None:
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
    side.text(0.065, 0.33, "wake up", 0.07, _YELLOW, width=0.11)
    side.small_print(0.015, 0.42, 0.12, 0.86, (236, 220, 200), lines=9, seed=5)
    side.text(0.935, 0.32, "GROUND", 0.06, _WHITE, width=0.11)
    side.barcode(0.885, 0.42, 0.985, 0.66, seed=5)
    side.small_print(0.885, 0.72, 0.985, 0.88, _YELLOW, lines=4, seed=6)
    for name, ground, ink in (("lid", (30, 28, 30), (70, 68, 70)), ("base", red, dark)):
        panel = panels[name]
        panel.fill(ground)
        for radius in (0.42, 0.30, 0.12):
            panel.disc(0.5, 0.5, radius, ink)
            panel.disc(0.5, 0.5, radius - 0.012, ground)
    panels["lid"].text(0.5, 0.31, "FRESH SEAL", 0.07, (120, 118, 120), width=0.5)
    panels["base"].small_print(0.35, 0.66, 0.65, 0.74, dark, lines=2, seed=7)


def tape(panels: Panels) -> None:
    """A roll of silver cloth tape on a cardboard core."""
    silver, weave, card = (152, 156, 160), (136, 140, 145), (196, 164, 120)
    outside = panels["outside"]
    outside.fill(silver)
    for k in range(120):
        outside.rect(k / 120, 0, k / 120 + 0.003, 1, weave)
    for k in range(16):
        outside.rect(0, k / 16, 1, k / 16 + 0.02, weave)
    outside.rect(0.93, 0, 0.935, 1, (90, 94, 98))
    outside.rect(0.4, 0.12, 0.6, 0.88, _BLUE, 0.08)
    outside.text(0.5, 0.36, "CLOTH TAPE", 0.24, _WHITE, width=0.18)
    outside.text(0.5, 0.68, "48 mm x 25 m", 0.18, _YELLOW, width=0.17)
    inside = panels["inside"]
    inside.fill(card)
    for k in range(24):
        x = k / 24
        inside.polygon(
            [(x, 1), (x + 0.01, 1), (x + 0.05, 0), (x + 0.04, 0)], (178, 146, 104)
        )
    inside.rect(0.1, 0.2, 0.3, 0.8, (40, 120, 70))
    inside.rect(0.6, 0.2, 0.85, 0.8, _WHITE)
    inside.small_print(0.62, 0.3, 0.83, 0.75, _BLACK, lines=4, seed=8)
    for name, turns in (("top", (168, 172, 176)), ("bottom", (120, 124, 128))):
        panel = panels[name]
        panel.fill(silver)
        for k in range(12):
            panel.disc(0.5, 0.5, 0.5 - 0.0075 * k, turns if k % 2 else silver)
        panel.disc(0.5, 0.5, 0.418, card)


def glucose(panels: Panels) -> None:
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
    side.text(0.4, 0.79, "50", 0.12, _WHITE, width=0.1)
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


def book(panels: Panels) -> None:
    """A paperback of jokes: cover, back, spine and page edges."""
    cover, back = panels["+x"], panels["-x"]
    cover.fill((236, 66, 120))
    cover.star(0.5, 0.3, 0.27, _YELLOW)
    for y, words in ((0.19, "LAUGH"), (0.3, "OUT"), (0.41, "LOUD")):
        cover.text(0.5, y, words, 0.105, _BLUE, width=0.58)
    cover.rect(0, 0.58, 1, 0.68, _BLUE)
    cover.text(0.5, 0.63, "JOKES FOR KIDS", 0.07, _WHITE)
    for x, colour in (
        (0.2, (60, 200, 220)),
        (0.5, (120, 210, 60)),
        (0.8, (250, 150, 40)),
    ):
        _laughing_face(cover, x, 0.83, 0.085, colour)
    back.fill((60, 190, 214))
    back.text(0.5, 0.08, "KNOCK KNOCK!", 0.075, _WHITE)
    for k, colour in enumerate(((255, 255, 250), (255, 236, 140), (255, 206, 226))):
        y, x = 0.16 + 0.19 * k, 0.05 + 0.08 * (k % 2)
        back.rect(x, y, x + 0.8, y + 0.14, colour, 0.03)
        back.polygon(
            [(x + 0.1, y + 0.13), (x + 0.2, y + 0.13), (x + 0.08, y + 0.17)], colour
        )
        back.small_print(
            x + 0.05, y + 0.03, x + 0.75, y + 0.12, _BLUE, lines=3, seed=10 + k
        )
    back.rect(0, 0.76, 1, 1, (236, 66, 120))
    back.barcode(0.52, 0.8, 0.94, 0.96, seed=11)
    back.text(0.26, 0.88, "$3.99", 0.05, _YELLOW, width=0.4)
    spine = panels["-z"].turned()
    spine.fill(_BLUE)
    spine.text(0.4, 0.5, "LAUGH OUT LOUD", 0.6, _YELLOW, width=0.6)
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


def lightbulb(panels: Panels) -> None:
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
        panel.text(0.32, 0.78, watts, 0.17, _WHITE, width=0.45)
        words = "WATT" if watts == "60" else "LIFE"
        panel.text(0.73, 0.8, words, 0.08, warm, width=0.4)
        panel.text(0.5, 0.93, "light bulbs", 0.06, _WHITE, bold=False)
    facts, code = panels["+x"], panels["-x"]
    facts.facts(0.1, 0.05, 0.9, 0.56, "Lighting Facts", rows=7)
    facts.text(0.5, 0.74, "800 LUMEN", 0.09, warm)
    facts.text(0.5, 0.88, "2700 K", 0.07, _WHITE)
    code.barcode(0.14, 0.06, 0.86, 0.26, seed=12)
    code.small_print(0.12, 0.32, 0.88, 0.56, (70, 70, 80), lines=7, seed=12)
    for k in range(4):
        code.disc(0.17 + 0.22 * k, 0.74, 0.05, warm)
    code.text(0.5, 0.89, "4 BULBS", 0.08, _WHITE)
    panels["+y"].fill(blue)
    panels["+y"].text(0.5, 0.38, "60 W", 0.3, _WHITE)
    panels["+y"].text(0.5, 0.7, "SOFT WHITE", 0.13, warm)
    panels["-y"].fill(warm)
    panels["-y"].text(0.5, 0.5, "E26", 0.3, blue)


def tissues(panels: Panels) -> None:
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
        panels[name].rect(0.12, 0.36, 0.88, 0.66, _WHITE, 0.1)
        panels[name].text(0.5, 0.48, words, 0.13, (30, 84, 120), width=0.68)
        panels[name].text(0.5, 0.6, "3-ply  75 sheets", 0.06, (60, 150, 160), width=0.5)
    panels["+x"].disc(0.5, 0.5, 0.2, _WHITE)
    panels["+x"].text(0.5, 0.47, "75", 0.18, (226, 96, 120), width=0.34)
    panels["+x"].text(0.5, 0.62, "tissues", 0.06, (30, 84, 120), width=0.3)
    top = panels["+y"]
    top.disc(0.5, 0.5, 0.3, _WHITE)
    top.disc(0.5, 0.5, 0.27, (60, 84, 96))
    top.polygon(
        [(0.34, 0.6), (0.4, 0.38), (0.55, 0.3), (0.66, 0.46), (0.6, 0.66)], _WHITE
    )
    top.polygon([(0.46, 0.62), (0.5, 0.4), (0.6, 0.5)], (214, 220, 224))
    base = panels["-y"]
    base.barcode(0.1, 0.12, 0.46, 0.42, seed=14)
    base.small_print(0.54, 0.14, 0.92, 0.44, (60, 84, 110), lines=6, seed=14)
    base.text(0.5, 0.62, "RECYCLE ME", 0.1, (40, 130, 90))
    base.small_print(0.1, 0.74, 0.9, 0.92, (60, 84, 110), lines=4, seed=15)


def soap(panels: Panels) -> None:
    """A white carton of soap with a blue wave and gold lettering."""
    blue, gold, pale = (30, 74, 150), (190, 150, 64), (226, 236, 246)
    for name in panels:
        panels[name].fill(_WHITE)
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
    panels["+x"].text(0.82, 0.74, "2", 0.16, _WHITE, width=0.2)
    panels["-x"].rect(0.66, 0.74, 0.94, 0.94, blue, 0.04)
    panels["-x"].text(0.8, 0.84, "106 g", 0.1, _WHITE, width=0.24)
    panels["+y"].rect(0, 0, 1, 0.25, blue)
    side = panels["+y"].turned()
    side.fill(blue)
    side.text(0.5, 0.4, "soap bar", 0.4, _WHITE)
    side.rect(0, 0.8, 1, 0.86, gold)
    panels["+y"].paste_turned(side)
    under = panels["-y"].turned()
    under.fill(_WHITE)
    under.barcode(0.05, 0.15, 0.4, 0.85, seed=16)
    under.small_print(0.46, 0.15, 0.95, 0.9, blue, lines=6, seed=16)
    panels["-y"].paste_turned(under)
    panels["+z"].fill(pale)
    panels["+z"].text(0.5, 0.3, "mild", 0.16, blue)
    panels["+z"].small_print(0.12, 0.5, 0.88, 0.9, blue, lines=6, seed=17)
    panels["-z"].fill(blue)
    panels["-z"].text(0.5, 0.5, "pH 7", 0.2, gold)


def glue(panels: Panels) -> None:
    """A white flat bottle with an orange cap and a blue label."""
    side, orange, blue = panels["side"], (242, 104, 26), (24, 82, 168)
    side.fill((244, 244, 240))
    cap = 0.325
    side.rect(0, 0, 1, cap, orange)
    for k in range(48):
        side.rect(k / 48, 0.2, k / 48 + 0.006, cap - 0.01, (206, 82, 16))
    side.rect(0.31, 0.53, 0.69, 0.95, blue, 0.03)
    side.rect(0.31, 0.56, 0.69, 0.66, orange)
    side.text(0.5, 0.61, "WASHABLE", 0.06, _WHITE, width=0.3)
    side.text(0.5, 0.735, "SCHOOL", 0.085, _WHITE, width=0.33)
    side.text(0.5, 0.83, "GLUE", 0.09, _YELLOW, width=0.33)
    side.text(0.5, 0.91, "no run  118 ml", 0.04, _WHITE, width=0.3, bold=False)
    for left, right in ((0.0, 0.19), (0.81, 1.0)):
        side.rect(left, 0.53, right, 0.95, (214, 228, 244))
    side.text(0.095, 0.58, "DIRECTIONS", 0.04, blue, width=0.17)
    side.small_print(0.02, 0.63, 0.17, 0.92, blue, lines=9, seed=18)
    side.barcode(0.84, 0.57, 0.97, 0.76, seed=18)
    side.small_print(0.83, 0.8, 0.97, 0.93, blue, lines=4, seed=19)
    panels["tip"].fill(orange)
    panels["base"].fill((226, 226, 222))
    panels["base"].text(0.5, 0.5, "118 ml", 0.1, (120, 120, 120), width=0.5)


def baseball(panels: Panels) -> None:
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
    skin.text(0.37, 0.45, "LEAGUE BALL", 0.06, _BLUE, width=0.14)
    skin.text(0.37, 0.53, "No. 9", 0.055, _BLUE, width=0.1)


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
        panel.rect(x, tip - 0.08, x + 0.12, tip - 0.06, _BLACK)
        panel.rect(x, 0.54, x + 0.12, 0.56, _BLACK)


def _felt_block(panel: Panel) -> None:
    panel.polygon([(0.05, 0.62), (0.12, 0.3), (0.36, 0.38), (0.3, 0.72)], (60, 62, 70))
    panel.polygon([(0.05, 0.62), (0.3, 0.72), (0.3, 0.86), (0.05, 0.76)], (34, 34, 40))
    panel.polygon([(0.3, 0.72), (0.36, 0.38), (0.36, 0.52), (0.3, 0.86)], (20, 20, 24))
    panel.rect(0.12, 0.5, 0.28, 0.54, (150, 200, 40))


def _coffee_label(panel: Panel, x: float) -> None:
    panel.rect(x - 0.15, 0.2, x + 0.15, 0.96, (40, 36, 78), 0.06)
    panel.star(x, 0.42, 0.2, (246, 150, 30), 20)
    panel.disc(x, 0.42, 0.12, _YELLOW)
    panel.rect(x - 0.15, 0.5, x + 0.15, 0.72, (186, 22, 30))
    panel.text(x, 0.61, "COFFEE", 0.17, _WHITE, width=0.28)
    panel.text(x, 0.79, "CLASSIC ROAST", 0.075, _YELLOW, width=0.26)
    panel.text(x, 0.89, "medium  320 g", 0.05, _WHITE, width=0.22, bold=False)


def _laughing_face(panel: Panel, x: float, y: float, r: float, colour: Colour) -> None:
    aspect = panel.image.height / panel.image.width
    panel.disc(x, y, r, colour)
    for sign in (-1, 1):
        panel.disc(x + sign * 0.36 * r * aspect, y - 0.3 * r, 0.16 * r, _BLACK)
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
