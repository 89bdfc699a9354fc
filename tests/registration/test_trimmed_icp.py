# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from physim_drake.poses import Array, SymmetryGroup, make_pose, transform_points
from physim_drake.registration.distance_field import build_distance_field
from physim_drake.registration.registration_model import registration_model
from physim_drake.registration.trimmed_icp import (
    TrimmedIcpConfig,
    apply_step,
    lcp_scores,
    trimmed_icp,
)
from tests.synthetic import l_shape, perturbed, pose_error

X_SO = make_pose(
    Rotation.from_rotvec([0.3, -0.8, 1.2]).as_matrix(), np.array([0.1, -0.05, 0.2])
)
FIELD = build_distance_field(trimesh.creation.box((0.06, 0.08, 0.1)))
# On the middle of the box's top, 5 mm apart.
TOP = np.array([[0.005 * i, 0.0, 0.05] for i in range(-4, 4)])
UP = np.tile([0.0, 0.0, 1.0], (len(TOP), 1))


def observed(seed: int, outliers: float) -> tuple[Array, Array]:
    """Points and normals of the L at `X_SO`, with this share of outliers."""
    generator = np.random.default_rng(seed)
    points, normals = l_shape().surface_sample(300)
    points, normals = transform_points(X_SO, points), normals @ X_SO[:3, :3].T
    count = int(len(points) * outliers / (1 - outliers))
    junk = generator.uniform(points.min(axis=0), points.max(axis=0), (count, 3))
    directions = generator.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.concatenate([points, junk]), np.concatenate([normals, directions])


def test_lcp_counts_the_points_within_delta() -> None:
    points = TOP.copy()
    points[:2, 2] += 0.004
    points[2, 2] -= 0.004
    poses = np.eye(4)[None]
    assert lcp_scores(FIELD, poses, points, UP, 0.003).tolist() == [5 / 8]
    assert lcp_scores(FIELD, poses, points, UP, 0.005).tolist() == [1.0]


def test_lcp_counts_only_points_whose_normals_agree() -> None:
    normals = UP.copy()
    normals[0] *= -1
    normals[1] = [1.0, 0.0, 0.0]
    normals[2] = [0.8, 0.0, 0.6]
    poses = np.eye(4)[None]
    assert lcp_scores(FIELD, poses, TOP, normals, 0.003).tolist() == [5 / 8]
    looser = lcp_scores(FIELD, poses, TOP, normals, 0.003, cos_normal=0.5)
    assert looser.tolist() == [6 / 8]


def test_lcp_moves_with_the_pose() -> None:
    points, normals = transform_points(X_SO, TOP), UP @ X_SO[:3, :3].T
    away = X_SO.copy()
    away[:3, 3] += 0.02 * X_SO[:3, 2]
    scores = lcp_scores(FIELD, np.stack([X_SO, away]), points, normals, 0.003)
    assert scores.tolist() == [1.0, 0.0]


def test_lcp_at_several_distances_is_that_at_each() -> None:
    points = TOP + np.outer(np.arange(len(TOP)), [0.0, 0.0, 0.001])
    deltas = (0.0015, 0.0065, 0.0035)
    together = lcp_scores(FIELD, np.eye(4)[None], points, UP, deltas)
    assert together.tolist() == [[2 / 8, 7 / 8, 4 / 8]]
    alone = [lcp_scores(FIELD, np.eye(4)[None], points, UP, d) for d in deltas]
    np.testing.assert_array_equal(together, np.stack(alone, axis=1))


def test_lcp_of_nothing_is_zero() -> None:
    none = np.zeros((0, 3))
    assert lcp_scores(FIELD, np.stack([X_SO, X_SO]), none, none, 0.003).tolist() == [
        0.0,
        0.0,
    ]


@pytest.mark.parametrize("seed", range(4))
def test_trimmed_icp_comes_back_from_8_mm_and_6_degrees(seed: int) -> None:
    points, normals = observed(seed, outliers=0.25)
    field = registration_model(l_shape()).distance_field
    start = perturbed(X_SO, 0.008, np.radians(6), seed)
    X, residual = trimmed_icp(
        field, start[None], points, normals, TrimmedIcpConfig(keep=0.7, iterations=30)
    )
    shift, turn = pose_error(X[0], X_SO, SymmetryGroup())
    assert shift < 0.5
    assert turn < 0.4
    assert residual[0] < 0.001
    assert start[:3, 3] == pytest.approx(perturbed(X_SO, 0.008, 1, seed)[:3, 3])


def test_without_trimming_the_outliers_pull() -> None:
    points, normals = observed(0, outliers=0.25)
    field = registration_model(l_shape()).distance_field
    hard = TrimmedIcpConfig(soft=False, iterations=30, cutoff=0.02)
    errors = [
        pose_error(
            trimmed_icp(field, X_SO[None], points, normals, config)[0][0],
            X_SO,
            SymmetryGroup(),
        )[0]
        for config in (replace(hard, cos_normal=-1.0), replace(hard, keep=0.7))
    ]
    assert errors[1] < 0.3 * errors[0]


def test_soft_limits_need_no_share_of_outliers_to_be_known() -> None:
    field = registration_model(l_shape()).distance_field
    hard = TrimmedIcpConfig(keep=0.7, soft=False, cutoff=0.01)
    shifts = []
    for config in (hard, TrimmedIcpConfig()):
        for seed in range(4):
            points, normals = observed(seed, outliers=0.1 + 0.1 * seed)
            start = perturbed(X_SO, 0.008, np.radians(6), seed)
            X, _ = trimmed_icp(field, start[None], points, normals, config)
            shifts.append(pose_error(X[0], X_SO, SymmetryGroup())[0])
    assert np.mean(shifts[4:]) < np.mean(shifts[:4])


def test_poses_are_refined_independently() -> None:
    points, normals = observed(1, outliers=0.1)
    field = registration_model(l_shape()).distance_field
    starts = np.stack([perturbed(X_SO, 0.006, 0.06, seed) for seed in range(3)])
    together, residuals = trimmed_icp(field, starts, points, normals)
    for n, start in enumerate(starts):
        alone, residual = trimmed_icp(field, start[None], points, normals)
        np.testing.assert_array_equal(alone[0], together[n])
        assert residual[0] == residuals[n]


def test_a_pose_far_from_all_points_stays() -> None:
    points, normals = observed(0, outliers=0.0)
    field = registration_model(l_shape()).distance_field
    far = make_pose(p=[0.0, 0.0, 3.0])
    X, residual = trimmed_icp(field, far[None], points, normals)
    np.testing.assert_array_equal(X[0], far)
    assert np.isinf(residual[0])


def test_too_few_points_leave_the_pose() -> None:
    X, residual = trimmed_icp(FIELD, X_SO[None], TOP[:5], UP[:5])
    np.testing.assert_array_equal(X[0], X_SO)
    assert np.isinf(residual[0])


@given(st.integers(0, 2**31))
def test_a_step_turns_about_the_centre(seed: int) -> None:
    generator = np.random.default_rng(seed)
    step, centre = 0.5 * generator.normal(size=6), generator.normal(size=3)
    X = X_SO.copy()
    apply_step(X, step, centre)
    p_O = generator.normal(size=3)
    before, after = transform_points(X_SO, p_O[None])[0], transform_points(X, p_O[None])
    R = Rotation.from_rotvec(step[:3]).as_matrix()
    np.testing.assert_allclose(after[0], R @ (before - centre) + centre + step[3:])
