# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physim_drake.objects.containers import ContainerName, load_container
from physim_drake.rendering.vivid import (
    draw_appearance,
    draw_print,
    draw_texture,
    draw_tint,
)


@given(seed=st.integers(0, 10_000))
def test_textures_are_images_of_the_size_asked_for(seed: int):
    rng = np.random.default_rng(seed)
    for draw in (draw_texture, draw_print):
        texture = draw(rng, 48)
        assert texture.shape == (48, 48, 3)
        assert texture.dtype == np.uint8


def test_textures_differ_from_each_other():
    rng = np.random.default_rng(0)
    means = np.array([draw_texture(rng, 32).mean(axis=(0, 1)) for _ in range(60)])
    assert (means.std(axis=0) > 30).all()


def test_the_same_seed_draws_the_same():
    first, second = (draw_appearance(np.random.default_rng(4)) for _ in range(2))
    assert first == second
    container = load_container(ContainerName.TABLE)
    for a, b in zip(first.textures(container), second.textures(container), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", list(ContainerName))
def test_every_box_of_a_container_has_a_texture(name: ContainerName):
    container = load_container(name)
    for seed in range(6):
        look = draw_appearance(np.random.default_rng(seed))
        assert len(look.textures(container)) == len(container.boxes)
        assert 2 <= len(look.lights) <= 4


@given(seed=st.integers(0, 10_000), spread=st.floats(0, 0.5))
def test_tints_have_full_brightness(seed: int, spread: float):
    tint = draw_tint(np.random.default_rng(seed), spread)
    assert max(tint) == pytest.approx(1.0)
    assert min(tint) > 0
