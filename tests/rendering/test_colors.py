# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np

from physim_drake.rendering.colors import diverging_colors, object_color


def test_residuals_go_from_blue_over_white_to_red() -> None:
    blue, white, red = diverging_colors(np.array([-1.0, 0.0, 1.0])).astype(int)
    assert blue[2] > blue[0] + 60
    assert red[0] > red[2] + 60
    assert white.min() > 240
    beyond = diverging_colors(np.array([-9.0, 9.0]))
    np.testing.assert_array_equal(beyond, [blue, red])


def test_what_agrees_less_is_darker_on_both_sides() -> None:
    brightness = diverging_colors(np.linspace(-1, 1, 41)).sum(axis=-1, dtype=int)
    assert (np.diff(brightness[:21]) > 0).all()
    assert (np.diff(brightness[20:]) < 0).all()


def test_an_image_of_values_becomes_an_image_of_colours() -> None:
    colors = diverging_colors(np.zeros((2, 3), np.float32))
    assert colors.shape == (2, 3, 3)
    assert colors.dtype == np.uint8


def test_ten_objects_are_told_apart() -> None:
    colors = np.array([object_color(k) for k in range(10)])
    apart = np.linalg.norm(colors[:, None] - colors[None], axis=-1)
    assert apart[~np.eye(10, dtype=bool)].min() > 50
    assert object_color(10) == object_color(0)
