# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from physim_drake.camera import DepthImage
from physim_drake.rendering.windows import DepthWindow, crop, paste
from physim_drake.search.states import composite

seeds = st.integers(0, 2**31)


def sparse(seed: int, share: float = 0.15) -> DepthImage:
    generator = np.random.default_rng(seed)
    drawn = generator.random((7, 9)) < share
    return np.where(drawn, generator.uniform(0.3, 1, (7, 9)), 0).astype(np.float32)


@given(seeds)
def test_a_cropped_image_pasted_onto_nothing_is_itself(seed: int) -> None:
    image = sparse(seed)
    window = crop(image)
    pasted = np.zeros_like(image)
    paste(pasted, window)
    np.testing.assert_array_equal(pasted, image)
    np.testing.assert_array_equal(window.of(image), window.depth)


def test_the_crop_is_the_smallest() -> None:
    image = np.zeros((7, 9), dtype=np.float32)
    image[2, 3], image[4, 7] = 0.5, 0.6
    window = crop(image)
    assert (window.row, window.column) == (2, 3)
    assert window.depth.shape == (3, 5)


def test_nothing_drawn_is_an_empty_window() -> None:
    window = crop(np.zeros((7, 9), dtype=np.float32))
    assert window.depth.size == 0
    image = sparse(0)
    kept = image.copy()
    paste(image, window)
    np.testing.assert_array_equal(image, kept)


@given(seeds)
def test_pasting_is_compositing_of_the_part(seed: int) -> None:
    below, above = sparse(seed, 0.7), sparse(seed + 1, 0.5)
    pasted = below.copy()
    paste(pasted, crop(above))
    np.testing.assert_array_equal(pasted, composite(below, above))


def test_a_window_s_pixels_of_an_image_can_be_written() -> None:
    image = np.zeros((7, 9), dtype=np.float32)
    DepthWindow(1, 2, np.ones((2, 3), dtype=np.float32)).of(image)[:] = 4.0
    assert image.sum() == 24
    assert image[1, 2] == image[2, 4] == 4
