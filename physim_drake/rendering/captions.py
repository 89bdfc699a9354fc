# SPDX-License-Identifier: MIT
"""Names in pictures, on dark backgrounds that do not cover each other."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from physim_drake.rendering.colors import Color

FONT = cv2.FONT_HERSHEY_SIMPLEX


def font_scale(canvas: NDArray[np.uint8]) -> float:
    """The size of letters that suits the width of a picture."""
    return float(canvas.shape[1]) / 1280


class Captions:
    """Writes names into one picture.

    Args:
        canvas: RGB picture that is written into, (height, width, 3).
    """

    def __init__(self, canvas: NDArray[np.uint8]) -> None:
        self._canvas = canvas
        self._scale = font_scale(canvas)
        self._taken: list[tuple[int, int, int, int]] = []

    def write(
        self, text: str, column: int, bottom: int, color: Color, *, centred: bool
    ) -> None:
        """Writes above `bottom`. If that is taken, it writes next above, or else below.

        Args:
            text: text to write.
            column: column of the text's left end, or of its middle if `centred`, px.
            bottom: row that the text stays above, px.
            color: colour of the letters before it is made lighter.
            centred: whether the text is centred on `column`.
        """
        (width, height), below = cv2.getTextSize(text, FONT, self._scale, 1)
        width, height = width + 4, height + below + 4
        rows, columns = self._canvas.shape[:2]
        left = column - width // 2 if centred else column
        left = int(np.clip(left, 0, max(columns - width, 0)))
        last = max(rows - height, 0)
        first = int(np.clip(bottom - height, 0, last))
        free = (
            t
            for t in (*range(first, -1, -1), *range(first, last + 1))
            if self._free(left, t, left + width, t + height)
        )
        top = next(free, first)
        self._taken.append((left, top, left + width, top + height))
        end = (left + width - 1, top + height - 1)
        cv2.rectangle(self._canvas, (left, top), end, (0, 0, 0), -1)
        light = tuple(128 + c // 2 for c in color)
        start = (left + 2, top + height - below - 2)
        cv2.putText(self._canvas, text, start, FONT, self._scale, light, 1, cv2.LINE_AA)

    def _free(self, left: int, top: int, right: int, bottom: int) -> bool:
        return all(
            right <= a or c <= left or bottom <= b or d <= top
            for a, b, c, d in self._taken
        )
