# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from physim_drake.poses import (
    Array,
    ContinuousAxis,
    SymmetryGroup,
    exp_pose,
    inverse,
    is_rotation,
    make_pose,
    nearest_rotation,
    rotation_angle,
    transform_points,
)

seeds = st.integers(0, 2**31)


def random_poses(seed: int, count: int) -> Array:
    generator = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, rng=generator).as_matrix()
    poses[:, :3, 3] = generator.normal(size=(count, 3))
    return poses


def about(axis: int, degrees: float) -> Array:
    vector = np.radians(degrees) * np.eye(3)[axis]
    return make_pose(Rotation.from_rotvec(vector).as_matrix())


def axis_through_origin(direction: Array) -> ContinuousAxis:
    return ContinuousAxis(direction / np.linalg.norm(direction), np.zeros(3))


GROUPS = {
    "none": SymmetryGroup(),
    "box": SymmetryGroup(np.stack([np.eye(4), *(about(a, 180) for a in range(3))])),
    "square": SymmetryGroup(np.stack([about(2, 90.0 * k) for k in range(4)])),
    "bottle": SymmetryGroup(axes=(axis_through_origin(np.array([1.0, 2.0, -0.5])),)),
    "can": SymmetryGroup(
        np.stack([np.eye(4), about(0, 180)]),
        (axis_through_origin(np.array([0.0, 1.0, 0.0])),),
    ),
}
BALL = SymmetryGroup(axes=tuple(axis_through_origin(a) for a in np.eye(3)))


@given(seeds)
def test_inverse_undoes_a_pose(seed: int) -> None:
    X = random_poses(seed, 5)
    np.testing.assert_allclose(
        X @ inverse(X), np.tile(np.eye(4), (5, 1, 1)), atol=1e-12
    )


@given(seeds)
def test_points_go_through_the_matrix(seed: int) -> None:
    X = random_poses(seed, 3)
    points = np.random.default_rng(seed).normal(size=(7, 3))
    homogeneous = np.concatenate([points, np.ones((7, 1))], axis=1)
    expected = np.einsum("mij,nj->mni", X, homogeneous)[..., :3]
    np.testing.assert_allclose(transform_points(X, points), expected, atol=1e-12)
    np.testing.assert_allclose(transform_points(X[0], points), expected[0], atol=1e-12)


@given(seeds, st.floats(0, np.pi))
def test_rotation_angle_is_that_of_the_axis_and_angle(seed: int, angle: float) -> None:
    axis = np.random.default_rng(seed).normal(size=3)
    R = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
    assert rotation_angle(R) == pytest.approx(angle, abs=1e-7)


@given(seeds)
def test_nearest_rotation_is_a_rotation_and_the_nearest(seed: int) -> None:
    generator = np.random.default_rng(seed)
    M = generator.normal(size=(4, 3, 3))
    R = nearest_rotation(M)
    assert all(is_rotation(one, 1e-9) for one in R)
    error = np.linalg.norm(M - R, axis=(1, 2))
    others = Rotation.random(200, rng=generator).as_matrix()
    for m, e in zip(M, error, strict=True):
        assert (np.linalg.norm(m - others, axis=(1, 2)) >= e - 1e-9).all()


@given(seeds)
def test_nearest_rotation_keeps_rotations(seed: int) -> None:
    R = random_poses(seed, 4)[:, :3, :3]
    np.testing.assert_allclose(nearest_rotation(R), R, atol=1e-12)


@pytest.mark.parametrize(
    "R",
    [np.diag([1.0, 1.0, -1.0]), 1.01 * np.eye(3), np.full((3, 3), np.nan)],
    ids=["mirror", "scaled", "nan"],
)
def test_what_is_no_rotation(R: Array) -> None:
    assert not is_rotation(R)


@given(seeds)
def test_exp_pose_turns_and_shifts_apart(seed: int) -> None:
    xi = 0.3 * np.random.default_rng(seed).normal(size=(2, 3, 6))
    X = exp_pose(xi)
    assert X.shape == (2, 3, 4, 4)
    np.testing.assert_array_equal(X[..., :3, 3], xi[..., 3:])
    np.testing.assert_allclose(
        rotation_angle(X[..., :3, :3]), np.linalg.norm(xi[..., :3], axis=-1), atol=1e-9
    )


def test_a_turn_about_an_axis_keeps_the_axis() -> None:
    axis = ContinuousAxis(np.array([0.0, 0.6, 0.8]), np.array([0.1, 0.2, 0.3]))
    on_axis = axis.point + np.outer([-1.0, 0.0, 2.5], axis.axis)
    np.testing.assert_allclose(transform_points(axis.pose(1.234), on_axis), on_axis)


def brute_force_distance(group: SymmetryGroup, R_A: Array, R_B: Array) -> float:
    equivalents = R_B @ group.sampled(720)[:, :3, :3]
    return float(rotation_angle(R_A.T @ equivalents).min())


@pytest.mark.parametrize("name", GROUPS)
@settings(max_examples=25, deadline=None)
@given(seeds)
def test_rotation_distance_is_the_least_over_all_equivalents(
    name: str, seed: int
) -> None:
    group = GROUPS[name]
    A, B = random_poses(seed, 2)[:, :3, :3]
    distance = group.rotation_distance(A, B)
    # Brute force turns in steps of half a degree.
    assert distance == pytest.approx(
        brute_force_distance(group, A, B), abs=np.radians(0.3)
    )


@pytest.mark.parametrize("name", GROUPS)
@given(seeds)
def test_equivalent_rotations_are_at_distance_zero(name: str, seed: int) -> None:
    group = GROUPS[name]
    R = random_poses(seed, 1)[0, :3, :3]
    equivalents = R @ group.sampled(7)[:, :3, :3]
    assert group.rotation_distance(
        np.broadcast_to(R, equivalents.shape), equivalents
    ) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("name", GROUPS)
@given(seeds)
def test_pairwise_distances_are_symmetric_and_obey_the_triangle(
    name: str, seed: int
) -> None:
    R = random_poses(seed, 6)[:, :3, :3]
    d = GROUPS[name].rotation_distance(R, R, pairwise=True)
    np.testing.assert_allclose(d, d.T, atol=1e-7)
    assert (d[:, None] <= d[:, :, None] + d.T[None] + 1e-6).all()
    one_by_one = GROUPS[name].rotation_distance(R[1:], R[:-1])
    np.testing.assert_allclose(np.diag(d, -1), one_by_one, atol=1e-9)


@given(seeds)
def test_all_rotations_of_a_ball_are_the_same(seed: int) -> None:
    R = random_poses(seed, 3)[:, :3, :3]
    assert BALL.is_ball
    assert (BALL.rotation_distance(R, R[::-1], pairwise=True) == 0).all()


def test_a_bottle_is_no_ball() -> None:
    assert not GROUPS["bottle"].is_ball
    assert not GROUPS["none"].is_ball


def test_the_centre_lies_on_every_axis() -> None:
    centre = np.array([0.01, -0.02, 0.03])
    axes = tuple(ContinuousAxis(a, centre + 0.5 * a) for a in np.eye(3))
    np.testing.assert_allclose(SymmetryGroup(axes=axes).centre, centre, atol=1e-12)
    np.testing.assert_array_equal(GROUPS["box"].centre, np.zeros(3))
