# SPDX-License-Identifier: MIT
from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from physim_drake.poses import Array, make_pose, transform_points
from physim_drake.registration.distance_field import DistanceField, build_distance_field

RADIUS = 0.05
HALF = np.array([0.02, 0.03, 0.045])
seeds = st.integers(0, 2**31)


@cache
def sphere_field() -> DistanceField:
    return build_distance_field(trimesh.creation.icosphere(5, RADIUS))


@cache
def box_field() -> DistanceField:
    return build_distance_field(trimesh.creation.box(2 * HALF))


def box_distance(points: Array) -> Array:
    q = np.abs(points) - HALF
    outside = np.linalg.norm(np.maximum(q, 0), axis=1)
    return np.asarray(outside + np.minimum(q.max(axis=1), 0))


def cloud(seed: int, half: float, count: int = 200) -> Array:
    return np.random.default_rng(seed).uniform(-half, half, (count, 3))


@settings(deadline=None)
@given(seeds)
def test_sphere(seed: int) -> None:
    points = cloud(seed, 0.07)
    distances, _ = sphere_field().query(points)
    true = np.linalg.norm(points, axis=1) - RADIUS
    near = np.abs(true) < 0.005
    np.testing.assert_allclose(distances[near], true[near], atol=4e-4)
    np.testing.assert_allclose(distances[~near], true[~near], atol=2.5e-3)
    assert np.sqrt(np.mean((distances - true)[near] ** 2)) < 1e-4


@settings(deadline=None)
@given(seeds)
def test_box(seed: int) -> None:
    points = cloud(seed, 1.0) * (HALF + 0.025)
    distances, _ = box_field().query(points)
    true = box_distance(points)
    np.testing.assert_allclose(distances, true, atol=2.5e-3)
    # Over a face, away from edges, where the distance is linear, it is exact.
    sorted_q = np.sort(np.abs(points) - HALF, axis=1)
    flat = (np.abs(sorted_q[:, 2]) < 0.005) & (sorted_q[:, 1] < -0.01)
    np.testing.assert_allclose(distances[flat], true[flat], atol=2e-5)


@settings(deadline=None)
@given(seeds)
def test_gradients_point_away_from_the_surface(seed: int) -> None:
    directions = cloud(seed, 1.0)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for radius in (RADIUS - 0.003, RADIUS, RADIUS + 0.003):
        _, gradients = sphere_field().query(radius * directions)
        slopes = np.einsum("ni,ni->n", gradients, directions)
        assert slopes.min() > 0.8
        assert np.percentile(np.abs(slopes - 1), 90) < 0.05


@settings(deadline=None)
@given(seeds)
def test_near_the_grid_distances_are_never_far_off(seed: int) -> None:
    points = cloud(seed, 0.2)
    distances, _ = sphere_field().query(points)
    true = np.linalg.norm(points, axis=1) - RADIUS
    # Beyond the grid they are at most the way over its border.
    assert (distances > true - 2.5e-3).all()
    assert (distances < 1.2 * np.maximum(true, 0) + 2.5e-3).all()


@given(seeds)
def test_a_posed_object_is_looked_up_where_it_is(seed: int) -> None:
    generator = np.random.default_rng(seed)
    X_SO = make_pose(
        Rotation.random(rng=generator).as_matrix(), generator.normal(size=3)
    )
    p_O = cloud(seed, 0.08)
    d, g = box_field().query(p_O)
    posed_d, posed_g = box_field().query_posed(X_SO, transform_points(X_SO, p_O))
    np.testing.assert_allclose(posed_d, d, atol=1e-6)
    # Gradients jump from cell to cell.
    same = np.isclose(posed_g, g @ X_SO[:3, :3].T, atol=1e-6).all(axis=1)
    assert same.mean() > 0.98


def test_far_outside_the_distance_goes_on_growing() -> None:
    z = np.array([0.2, 0.5, 2.0])
    distances, gradients = box_field().query(np.outer(z, [0.0, 0.0, 1.0]))
    np.testing.assert_allclose(distances, z - HALF[2], atol=1e-3)
    np.testing.assert_allclose(gradients, np.tile([0.0, 0.0, 1.0], (3, 1)), atol=1e-6)


@pytest.mark.parametrize("thickness", [0.003, 0.01])
def test_the_inside_of_a_thin_plate(thickness: float) -> None:
    field = build_distance_field(trimesh.creation.box((0.1, 0.1, thickness)))
    z = thickness * np.array([-1.0, -0.5, 0.5, 1.0])
    distances, _ = field.query(np.array([[0.013, -0.021, height] for height in z]))
    np.testing.assert_allclose(
        distances, thickness * np.array([0.5, 0.0, 0.0, 0.5]), atol=2e-4
    )
    middle, _ = field.query(np.array([[0.013, -0.021, 0.0]]))
    assert -thickness / 2 - 1e-4 < middle[0] < -0.1 * thickness


def test_a_ring_is_empty_in_the_middle() -> None:
    field = build_distance_field(trimesh.creation.annulus(0.03, 0.05, 0.04))
    distances, _ = field.query(np.array([[0.0, 0.0, 0.0], [0.04, 0.0, 0.0]]))
    np.testing.assert_allclose(distances, [0.03, -0.01], atol=1e-3)


def test_a_cracked_box_is_still_solid() -> None:
    low = trimesh.creation.box(bounds=[-HALF, [HALF[0], HALF[1], -0.0005]])
    high = trimesh.creation.box(bounds=[[-HALF[0], -HALF[1], 0.0005], HALF])
    # Two halves, open towards each other, 1 mm apart.
    faces = [
        m.submesh([np.abs(m.triangles_center[:, 2]) > 0.001], append=True)
        for m in (low, high)
    ]
    cracked = trimesh.util.concatenate(faces)
    assert not cracked.is_watertight
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.03], [0.005, -0.01, -0.02]])
    distances, _ = build_distance_field(cracked).query(points)
    np.testing.assert_allclose(distances, box_distance(points), atol=2e-3)


def test_an_open_shell_has_a_surface_on_both_sides() -> None:
    box = trimesh.creation.box(2 * HALF)
    shell = box.submesh([box.face_normals[:, 2] < 0.5], append=True)
    field = build_distance_field(shell)
    points = np.array([[0.0, 0.0, -HALF[2] - 0.01], [HALF[0] + 0.01, 0.0, 0.0]])
    distances, _ = field.query(points)
    np.testing.assert_allclose(distances, 0.01, atol=2e-4)
    inner, _ = field.query(np.array([[0.0, 0.0, -HALF[2] + 0.01]]))
    assert abs(inner[0]) == pytest.approx(0.01, abs=2e-4)
