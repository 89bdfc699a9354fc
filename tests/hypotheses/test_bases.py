# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from physim_drake.hypotheses.bases import Bases, draw_bases
from physim_drake.poses import Array

GAP = 0.005
seeds = st.integers(0, 2**31)


def drawn(points: Array, reach: float = 1.0, count: int = 20, seed: int = 0) -> Bases:
    return draw_bases(points, reach, GAP, count, np.random.default_rng(seed))


def sheet(seed: int = 0) -> Array:
    """A slightly uneven sheet, 10 x 8 cm."""
    points = np.random.default_rng(seed).uniform(0, 0.1, (140, 3))
    return np.asarray(points * [1.0, 0.8, 0.03])


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_the_diagonals_cross_where_they_are_said_to(seed: int) -> None:
    points = sheet(seed)
    bases = drawn(points, seed=seed)
    assert len(bases.angles) > 10
    a, b, c, d = np.moveaxis(points[bases.corners], 1, 0)
    on_first = a + bases.ratios[:, :1] * (b - a)
    on_second = c + bases.ratios[:, 1:] * (d - c)
    gaps = np.linalg.norm(on_first - on_second, axis=1)
    assert gaps.max() < GAP
    # Nearest there: the gap is square to both.
    for line in (b - a, d - c):
        along = np.einsum("ni,ni->n", on_first - on_second, line)
        np.testing.assert_allclose(along, 0, atol=1e-12)
    cosine = np.einsum("ni,ni->n", b - a, d - c)
    cosine /= np.linalg.norm(b - a, axis=1) * np.linalg.norm(d - c, axis=1)
    np.testing.assert_allclose(np.cos(bases.angles), cosine, atol=1e-12)
    assert ((bases.ratios > 0.05) & (bases.ratios < 0.95)).all()


def test_bases_are_wide() -> None:
    points = sheet()
    bases = drawn(points, count=200)
    corners = points[bases.corners]
    first = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
    second = np.linalg.norm(corners[:, 3] - corners[:, 2], axis=1)
    assert np.median(first) > 0.05
    assert np.median(second * np.sin(bases.angles)) > 0.05


def test_no_diagonal_is_longer_than_the_object() -> None:
    points = sheet()
    bases = drawn(points, reach=0.04, count=200)
    corners = points[bases.corners]
    assert len(corners) > 50
    assert np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1).max() <= 0.04
    assert np.linalg.norm(corners[:, 3] - corners[:, 2], axis=1).max() <= 0.04


@pytest.mark.parametrize(
    "points",
    [np.zeros((10, 3)), np.arange(30.0).reshape(10, 3)],
    ids=["one point", "on a line, far apart"],
)
def test_what_has_no_base_gives_none(points: Array) -> None:
    assert drawn(points).corners.shape == (0, 4)


def test_the_same_seed_gives_the_same_bases() -> None:
    first, second, other = (drawn(sheet(), seed=seed) for seed in (1, 1, 2))
    assert first.corners.tolist() == second.corners.tolist()
    assert first.corners.tolist() != other.corners.tolist()
