# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from physim_drake.hypotheses.rigid_fit import best_rotation
from physim_drake.poses import Array, is_rotation, nearest_rotation

seeds = st.integers(0, 2**31)


def fitted(H: Array) -> Array:
    R = np.empty((3, 3))
    best_rotation(H, R)
    return R


@given(seeds, st.floats(1e-8, 1e3))
def test_it_is_the_projection_onto_rotations(seed: int, scale: float) -> None:
    H = scale * np.random.default_rng(seed).normal(size=(3, 3))
    R = fitted(H)
    assert is_rotation(R, 1e-12)
    best = np.trace(nearest_rotation(H).T @ H)
    assert np.trace(R.T @ H) == pytest.approx(best, rel=1e-9)


@given(seeds)
def test_points_in_a_plane_are_put_back(seed: int) -> None:
    generator = np.random.default_rng(seed)
    source = generator.normal(size=(4, 3)) * [1.0, 0.7, 0.0]
    turn = Rotation.random(rng=generator).as_matrix()
    R = fitted((source @ turn.T).T @ source)
    np.testing.assert_allclose(source @ R.T, source @ turn.T, atol=1e-6)


@pytest.mark.parametrize("angles", [(180, 0, 0), (0, 180, 0), (0, 0, 180), (0, 0, 0)])
def test_half_turns_are_no_exception(angles: tuple[float, float, float]) -> None:
    turn = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    np.testing.assert_allclose(fitted(turn @ np.diag([3.0, 2.0, 1.0])), turn, atol=1e-9)


def test_nothing_to_go_by_gives_a_rotation() -> None:
    assert is_rotation(fitted(np.zeros((3, 3))), 1e-12)
