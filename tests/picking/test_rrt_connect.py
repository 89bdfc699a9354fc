# SPDX-License-Identifier: MIT
from __future__ import annotations

from itertools import pairwise

import numpy as np

from physim_drake.picking.rrt_connect import rrt_connect, shortcut
from physim_drake.poses import Array

LOWER, UPPER = np.zeros(2), np.ones(2)
WEIGHTS = np.ones(2)
START, GOAL = np.array([0.1, 0.5]), np.array([0.9, 0.5])


def in_wall(points: Array) -> Array:
    """A wall across the middle with a gap at the top."""
    x, y = points[..., 0], points[..., 1]
    return np.asarray((np.abs(x - 0.5) < 0.05) & (y < 0.9))


def edge_free(a: Array, b: Array) -> bool:
    points = a + np.linspace(0, 1, 60)[:, None] * (b - a)
    return not in_wall(points).any()


def search(seed: int, iterations: int = 2000) -> Array | None:
    generator = np.random.default_rng(seed)
    return rrt_connect(
        START, GOAL, LOWER, UPPER, WEIGHTS, edge_free, generator, iterations, 0.1
    )


def densely(path: Array) -> Array:
    shares = np.linspace(0, 1, 300)[:, None]
    return np.concatenate([a + shares * (b - a) for a, b in pairwise(path)])


def length(path: Array) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def test_a_way_through_the_gap_is_found_from_end_to_end() -> None:
    for seed in range(5):
        path = search(seed)
        assert path is not None
        np.testing.assert_array_equal(path[0], START)
        np.testing.assert_array_equal(path[-1], GOAL)
        assert not in_wall(densely(path)).any()
        assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() < 0.1 + 1e-9


def test_the_same_seed_finds_the_same_way() -> None:
    first, second = search(3), search(3)
    assert first is not None
    assert second is not None
    np.testing.assert_array_equal(first, second)


def test_a_closed_wall_has_no_way_through() -> None:
    generator = np.random.default_rng(0)

    def closed(a: Array, b: Array) -> bool:
        return bool((a[0] < 0.5) == (b[0] < 0.5))

    path = rrt_connect(START, GOAL, LOWER, UPPER, WEIGHTS, closed, generator, 300, 0.1)
    assert path is None


def test_shortcuts_make_it_shorter_and_keep_it_free() -> None:
    path = search(1)
    assert path is not None
    short = shortcut(path, edge_free, WEIGHTS, np.random.default_rng(0), 100)
    np.testing.assert_array_equal(short[[0, -1]], [START, GOAL])
    assert not in_wall(densely(short)).any()
    corners = np.array([START, [0.45, 0.9], [0.55, 0.9], GOAL])
    assert length(short) < 0.9 * length(path)
    assert length(short) < 1.15 * length(corners)
    assert len(short) < len(path)


def test_a_straight_way_is_left_with_its_ends() -> None:
    path = np.linspace(START, [0.4, 0.2], 7)
    short = shortcut(path, edge_free, WEIGHTS, np.random.default_rng(0))
    np.testing.assert_array_equal(short, path[[0, -1]])


def test_weights_stretch_the_steps() -> None:
    generator = np.random.default_rng(0)
    weights = np.array([10.0, 1.0])

    def free(a: Array, b: Array) -> bool:
        return True

    path = rrt_connect(START, GOAL, LOWER, UPPER, weights, free, generator, 50, 0.5)
    assert path is not None
    assert np.abs(np.diff(path[:, 0])).max() <= 0.05 + 1e-9
