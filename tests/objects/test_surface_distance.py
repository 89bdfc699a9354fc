# SPDX-License-Identifier: MIT
from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
import trimesh

from physim_drake.objects.surface_distance import signed_distances


def test_distances_from_a_box_are_exact_on_all_sides() -> None:
    half = np.array([0.02, 0.03, 0.05])
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (500, 3))
    beyond = np.abs(points) - half
    expected = np.linalg.norm(np.maximum(beyond, 0), axis=1)
    expected += np.minimum(beyond.max(axis=1), 0)
    found = signed_distances(trimesh.creation.box(2 * half), points)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_large_and_small_faces_are_found_alike() -> None:
    box, ball = (
        trimesh.creation.box((0.2, 0.2, 0.2)),
        trimesh.creation.icosphere(4, 0.02),
    )
    both = box + ball.apply_translation([0, 0, 0.3])
    points = np.array([[0, 0, 0.11], [0, 0, 0.27], [0, 0, 0.21], [0, 0, 0.3]])
    found = signed_distances(both, points)
    np.testing.assert_allclose(found, [0.01, 0.01, 0.07, -0.02], atol=1e-4)


def test_a_point_as_far_from_all_faces_takes_little_memory() -> None:
    ball = trimesh.creation.icosphere(5, 0.05)
    tracemalloc.start()
    found = signed_distances(ball, np.zeros((50, 3)))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found == pytest.approx(-0.05 * np.ones(50), rel=1e-3)
    assert peak < 300e6
