# SPDX-License-Identifier: MIT
from __future__ import annotations

from functools import cache

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from physim_drake.hypotheses.pairs import PairIndex, pair_angles

seeds = st.integers(0, 2**31)


@cache
def small_index() -> PairIndex:
    points, normals = np.random.default_rng(0).normal(size=(2, 25, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return PairIndex(0.05 * points, normals)


@given(seeds)
def test_pair_angles_do_not_change_with_the_pose(seed: int) -> None:
    generator = np.random.default_rng(seed)
    p1, n1, p2, n2 = generator.normal(size=(4, 6, 3))
    n1 /= np.linalg.norm(n1, axis=1, keepdims=True)
    n2 /= np.linalg.norm(n2, axis=1, keepdims=True)
    R = Rotation.random(rng=generator).as_matrix()
    moved = pair_angles(p1 @ R.T + 1, n1 @ R.T, p2 @ R.T + 1, n2 @ R.T)
    np.testing.assert_allclose(moved, pair_angles(p1, n1, p2, n2), atol=1e-6)


def test_pair_angles_by_hand() -> None:
    x, y, z = np.eye(3)
    angles = np.degrees(pair_angles(0 * x, z, 2 * x, (x + z) / np.sqrt(2)))
    np.testing.assert_allclose(angles, [90, 45, 45])
    along = np.degrees(pair_angles(0 * x, x, x, y))
    np.testing.assert_allclose(along, [0, 90, 90], atol=1e-3)


@settings(max_examples=40)
@given(st.floats(0.0, 0.3), seeds)
def test_the_index_finds_exactly_the_pairs_that_fit(length: float, seed: int) -> None:
    index = small_index()
    angles = np.random.default_rng(seed).uniform(0.5, 2.5, 3)
    found = index.find(length, angles, delta=0.01, tolerance=0.8)
    pairs = set(zip(*found, strict=True))
    expected = set()
    for i in range(25):
        for j in range(25):
            p, q = index.points[[i, j]]
            if i == j or not abs(np.linalg.norm(q - p) - length) < 0.01:
                continue
            own = pair_angles(p, index.normals[i], q, index.normals[j])
            if np.abs(own - angles).max() < 0.8:
                expected.add((i, j))
    assert pairs == expected
