# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physim_drake.poses import Array, exp_pose
from physim_drake.registration.normal_equations import NormalEquations, geman_mcclure

seeds = st.integers(0, 2**31)


def rows(origin: Array, points: Array, gradients: Array) -> Array:
    """The Jacobian (N, 6) by its definition."""
    return np.concatenate([np.cross(points - origin, gradients), gradients], axis=1)


@given(seeds)
def test_they_are_the_sums_of_weighted_products(seed: int) -> None:
    generator = np.random.default_rng(seed)
    origins = generator.normal(size=(3, 3))
    p, g = generator.normal(size=(2, 8, 3))
    r, w = generator.normal(size=8), generator.uniform(size=8)
    w[3] = 0.0
    J = np.zeros((8, 18))
    equations = NormalEquations(origins)
    equations.add(1, p, g, r, w)
    J[:, 6:12] = rows(origins[1], p, g)
    np.testing.assert_allclose(equations.A, (J.T * w) @ J, atol=1e-12)
    np.testing.assert_allclose(equations.b, (J.T * w) @ r, atol=1e-12)
    equations.add_between(2, 0, p, g, r, w)
    K = np.zeros((8, 18))
    K[:, 12:], K[:, :6] = rows(origins[2], p, g), -rows(origins[0], p, g)
    np.testing.assert_allclose(equations.A, (J.T * w) @ J + (K.T * w) @ K, atol=1e-12)
    np.testing.assert_allclose(equations.b, ((J + K).T * w) @ r, atol=1e-12)


def test_what_does_not_move_has_no_equations() -> None:
    p, g = np.random.default_rng(0).normal(size=(2, 5, 3))
    one, other = NormalEquations(np.zeros((1, 3))), NormalEquations(np.zeros((1, 3)))
    one.add_between(-1, 0, p, g, np.ones(5), np.ones(5))
    other.add(0, p, g, -np.ones(5), np.ones(5))
    np.testing.assert_allclose(one.A, other.A)
    np.testing.assert_allclose(one.b, other.b)


def test_a_point_counts_for_the_nearest_object_alone() -> None:
    p, g = np.random.default_rng(0).normal(size=(2, 3, 3))
    distances = np.array([[0.001, -0.003, 0.02], [-0.002, 0.001, 0.03]])
    equations = NormalEquations(np.zeros((2, 3)))
    equations.add_nearest(p, distances, np.stack([g, g]), gate=0.01, scale=0.004)
    expected = NormalEquations(np.zeros((2, 3)))
    for n, q in ((0, slice(0, 1)), (1, slice(1, 2))):
        d = distances[n, q]
        expected.add(n, p[q], g[q], d, geman_mcclure(d, 0.004))
    np.testing.assert_allclose(equations.A, expected.A)
    np.testing.assert_allclose(equations.b, expected.b)


@given(seeds)
def test_a_step_takes_a_sphere_to_its_points(seed: int) -> None:
    generator = np.random.default_rng(seed)
    way = generator.normal(size=(60, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    points = way * 0.05
    X = np.eye(4)
    X[:3, 3] = generator.uniform(-0.002, 0.002, 3)
    for _ in range(8):
        offset = points - X[:3, 3]
        length = np.linalg.norm(offset, axis=1)
        equations = NormalEquations(X[None, :3, 3])
        equations.add(0, points, offset / length[:, None], length - 0.05, np.ones(60))
        X[:3, 3] += exp_pose(equations.solve(1e-2)[0])[:3, 3]
    assert np.linalg.norm(X[:3, 3]) < 1e-6


def test_what_nothing_determines_does_not_move() -> None:
    step = NormalEquations(np.zeros((2, 3))).solve(1e-2)
    np.testing.assert_array_equal(step, np.zeros((2, 6)))


def test_weights_fade_beyond_the_scale() -> None:
    weights = geman_mcclure(np.array([0.0, 0.004, -0.004, 0.04]), 0.004)
    assert weights[0] == 1
    assert weights[1] == weights[2] == pytest.approx(0.25)
    assert weights[3] < 1e-3
