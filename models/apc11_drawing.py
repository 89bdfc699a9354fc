# SPDX-License-Identifier: MIT
"""A small drawing board for product-like textures.

A `Panel` is the picture of one side of a product. Places on it are shares of its
width and height, from the upper left corner, so that a drawing does not depend on the
number of pixels. Heights of letters are shares of the panel's height.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from PIL import Image, ImageDraw, ImageFont

Colour = tuple[int, int, int]

WHITE, BLACK = (248, 248, 246), (24, 24, 26)
YELLOW, GREEN, RED, BLUE = (250, 202, 30), (0, 122, 76), (198, 30, 38), (22, 58, 140)

SIZE = 512
"""Number of pixels along each side of a texture."""

_SUPERSAMPLING = 3
_GUTTER = 2  # px around each panel


@dataclass(frozen=True)
class Panel:
    """One side of a product to draw on.

    Attributes:
        image: pixels, `_SUPERSAMPLING` times as fine as the texture.
    """

    image: Image.Image
    _pen: ImageDraw.ImageDraw = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_pen", ImageDraw.Draw(self.image))

    @classmethod
    def blank(cls, width: int, height: int) -> Panel:
        """An empty panel of `width` x `height` texture pixels."""
        size = (width * _SUPERSAMPLING, height * _SUPERSAMPLING)
        return cls(Image.new("RGB", size, (255, 255, 255)))

    def turned(self) -> Panel:
        """A blank panel to draw on sideways. Pass it to `paste_turned`."""
        return Panel(Image.new("RGB", (self.image.height, self.image.width)))

    def paste_turned(self, panel: Panel) -> None:
        """Covers this panel with a `turned` one, whose text then reads upwards."""
        self.image.paste(panel.image.transpose(Image.Transpose.ROTATE_90))

    def rect(
        self,
        x0: float,
        y0: float,
        x1: float,
        y1: float,
        fill: Colour,
        radius: float = 0,
    ) -> None:
        """Fills a rectangle; `radius` rounds its corners, a share of the height."""
        corner = radius * self.image.height
        box = (*self._at(x0, y0), *self._at(x1, y1))
        self._pen.rounded_rectangle(box, corner, fill=fill)

    def fill(self, colour: Colour) -> None:
        """Fills the whole panel."""
        self.rect(0, 0, 1, 1, colour)

    def disc(self, x: float, y: float, radius: float, fill: Colour) -> None:
        """Fills a circle; `radius` is a share of the height."""
        (px, py), r = self._at(x, y), radius * self.image.height
        self._pen.ellipse((px - r, py - r, px + r, py + r), fill=fill)

    def polygon(self, points: Iterable[tuple[float, float]], fill: Colour) -> None:
        """Fills a polygon."""
        self._pen.polygon([self._at(x, y) for x, y in points], fill=fill)

    def star(
        self, x: float, y: float, radius: float, fill: Colour, points: int = 16
    ) -> None:
        """Fills a star with `points` rays; `radius` is a share of the height."""
        px, py = self._at(x, y)
        angle = np.pi * np.arange(2 * points) / points
        r = radius * self.image.height * np.where(np.arange(2 * points) % 2, 0.72, 1.0)
        corners = np.stack([px + r * np.sin(angle), py - r * np.cos(angle)], axis=1)
        self._pen.polygon([(float(a), float(b)) for a, b in corners], fill=fill)

    def text(
        self,
        x: float,
        y: float,
        words: str,
        height: float,
        fill: Colour,
        *,
        bold: bool = True,
        width: float = 0.94,
    ) -> None:
        """Writes one line.

        Args:
            x: middle of the line.
            y: middle of its height.
            words: text of the line.
            height: size of the letters. It is reduced if the line would be too wide.
            fill: colour of the letters.
            bold: whether to thicken the strokes.
            width: largest width of the line.
        """
        pixels = height * self.image.height
        for _ in range(2):
            font = ImageFont.load_default(max(pixels, 4.0))
            stroke = pixels / 45 if bold else 0.0
            left, _, right, _ = self._pen.textbbox(
                (0, 0), words, font=font, anchor="mm", stroke_width=stroke
            )
            pixels *= min(1.0, width * self.image.width / (right - left))
        self._pen.text(
            self._at(x, y), words, fill, font, anchor="mm", stroke_width=stroke
        )

    def small_print(
        self,
        x0: float,
        y0: float,
        x1: float,
        y1: float,
        fill: Colour,
        *,
        lines: int,
        seed: int = 0,
    ) -> None:
        """Suggests a paragraph by dashes of the length of words."""
        rng = np.random.default_rng(seed)
        pitch = (y1 - y0) / lines
        for line in range(lines):
            x, y = x0, y0 + line * pitch
            end = x1 if line < lines - 1 else x0 + 0.6 * (x1 - x0)
            while x < end:
                word = float(rng.uniform(0.04, 0.16)) * (x1 - x0)
                self.rect(x, y, min(x + word, end), y + 0.45 * pitch, fill)
                x += word + 0.025 * (x1 - x0)

    def barcode(self, x0: float, y0: float, x1: float, y1: float, seed: int) -> None:
        """Draws a barcode on a white field."""
        self.rect(x0, y0, x1, y1, (250, 250, 250))
        widths = np.random.default_rng(seed).integers(1, 4, 47).astype(float)
        edges = np.concatenate([[0.0], np.cumsum(widths)])
        edges = x0 + (0.08 + 0.84 * edges / edges[-1]) * (x1 - x0)
        bottom = y1 - 0.12 * (y1 - y0)
        for left, right in zip(edges[0:-1:2], edges[1::2], strict=True):
            self.rect(left, y0 + 0.08 * (y1 - y0), right, bottom, (15, 15, 15))

    def facts(
        self, x0: float, y0: float, x1: float, y1: float, title: str, rows: int = 7
    ) -> None:
        """Draws a framed table of contents such as nutrition facts."""
        ink, paper = (20, 20, 20), (250, 250, 246)
        dx, dy = 0.03 * (x1 - x0), 0.02 * (y1 - y0)
        self.rect(x0, y0, x1, y1, ink)
        self.rect(x0 + dx, y0 + dy, x1 - dx, y1 - dy, paper)
        head = 0.16 * (y1 - y0)
        middle = (x0 + x1) / 2
        room = 0.86 * (x1 - x0)
        self.text(middle, y0 + 0.6 * head, title, 0.75 * head, ink, width=room)
        pitch = (y1 - y0 - head - 3 * dy) / rows
        for row in range(rows):
            y = y0 + head + row * pitch
            self.rect(x0 + 2 * dx, y, x1 - 2 * dx, y + 0.12 * pitch, ink)
            share = 0.35 + 0.25 * ((row * 5) % 3) / 2
            end = x0 + share * (x1 - x0)
            self.rect(x0 + 2 * dx, y + 0.4 * pitch, end, y + 0.7 * pitch, ink)
            self.rect(x1 - 5 * dx, y + 0.4 * pitch, x1 - 2 * dx, y + 0.7 * pitch, ink)

    def _at(self, x: float, y: float) -> tuple[float, float]:
        return (x * self.image.width, y * self.image.height)


@dataclass(frozen=True)
class Atlas:
    """The places of the panels on a texture.

    Attributes:
        places: left, top, width and height of each panel, px.
    """

    places: Mapping[str, tuple[int, int, int, int]]

    @classmethod
    def packed(cls, sizes: Mapping[str, tuple[float, float]]) -> Atlas:
        """Packs panels at the largest scale at which they all fit.

        Args:
            sizes: width and height of each panel, in any unit of length.
        """
        scale = SIZE / max(max(size) for size in sizes.values())
        while True:
            places = _shelves(sizes, scale)
            if places is not None:
                return cls(places)
            scale *= 0.995

    def blank_panels(self) -> dict[str, Panel]:
        """An empty panel for each place."""
        return {n: Panel.blank(w, h) for n, (_, _, w, h) in self.places.items()}

    def texture(self, panels: Mapping[str, Panel]) -> Image.Image:
        """Puts drawn panels on one picture of `SIZE` x `SIZE` pixels."""
        sheet = Image.new("RGB", (SIZE, SIZE), (128, 128, 128))
        for name, (left, top, width, height) in self.places.items():
            small = panels[name].image.resize((width, height), Image.Resampling.BOX)
            sheet.paste(small, (left, top))
        return sheet

    def coordinates(
        self, name: str, uv: np.ndarray[tuple[int, ...], np.dtype[np.float64]]
    ) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        """Texture coordinates (..., 2), origin lower left, of places on a panel.

        Half a pixel at the edges is left out, so that no neighbour shows through.

        Args:
            name: name of the panel.
            uv: places on the panel, (..., 2) in 0 .. 1, from its lower left corner.
        """
        left, top, width, height = self.places[name]
        size = np.array([width - 1.0, height - 1.0])
        corner = np.array([left + 0.5, SIZE - (top + height) + 0.5])
        return np.asarray((corner + uv * size) / SIZE)


def _shelves(
    sizes: Mapping[str, tuple[float, float]], scale: float
) -> dict[str, tuple[int, int, int, int]] | None:
    """Places panels row by row, the tallest first. Gives None if they do not fit."""
    places: dict[str, tuple[int, int, int, int]] = {}
    left, top, row = _GUTTER, _GUTTER, 0
    for name in _by_height(sizes):
        width, height = (max(1, round(scale * length)) for length in sizes[name])
        if left + width + _GUTTER > SIZE:
            left, top, row = _GUTTER, top + row + _GUTTER, 0
        if left + width + _GUTTER > SIZE or top + height + _GUTTER > SIZE:
            return None
        places[name] = (left, top, width, height)
        left, row = left + width + _GUTTER, max(row, height)
    return places


def _by_height(sizes: Mapping[str, tuple[float, float]]) -> Sequence[str]:
    return sorted(sizes, key=lambda name: (-sizes[name][1], name))
