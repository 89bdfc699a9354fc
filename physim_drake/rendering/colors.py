# SPDX-License-Identifier: MIT
"""Colours of what is drawn into images, RGB, 0 to 255."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Color = tuple[int, int, int]

_OBJECTS: tuple[Color, ...] = (
    (30, 120, 180),  # blue
    (255, 127, 15),  # orange
    (45, 160, 45),  # green
    (215, 40, 40),  # red
    (150, 105, 190),  # purple
    (140, 85, 75),  # brown
    (225, 120, 195),  # pink
    (127, 127, 127),  # grey
    (190, 190, 35),  # olive
    (25, 190, 207),  # cyan
)
_DIVERGING = np.array(
    [
        (5, 50, 100),  # at -1
        (35, 105, 175),
        (65, 145, 195),
        (145, 195, 220),
        (210, 230, 240),
        (247, 247, 247),  # at 0
        (253, 220, 200),
        (245, 165, 130),
        (215, 95, 80),
        (180, 25, 45),
        (105, 0, 30),  # at 1
    ],
    float,
)


def object_color(k: int) -> Color:
    """The colour of object `k` in every picture. Colours repeat after ten."""
    return _OBJECTS[k % len(_OBJECTS)]


def diverging_colors(share: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Colours (..., 3) of values from -1, blue, over 0, white, to 1, red.

    Args:
        share: values. Beyond -1 and 1 the colours stay the same.
    """
    places = np.linspace(-1.0, 1.0, len(_DIVERGING))
    channels = [np.interp(share, places, channel) for channel in _DIVERGING.T]
    return np.stack(channels, axis=-1).astype(np.uint8)
