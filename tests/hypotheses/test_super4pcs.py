# SPDX-License-Identifier: MIT
from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from physim_drake.hypotheses import super4pcs as module
from physim_drake.hypotheses.super4pcs import (
    PairIndex,
    Super4PcsConfig,
    pair_angles,
    pair_index,
    super4pcs,
)
from physim_drake.poses import (
    Array,
    is_rotation,
    make_pose,
    rotation_angle,
    transform_points,
)
from physim_drake.registration import lcp_scores
from physim_drake.registration_model import registration_model
from tests.synthetic import GLUE, l_shape, library, pair_apart, synthesize

X_SO = make_pose(
    Rotation.from_rotvec([0.3, -0.8, 1.2]).as_matrix(), np.array([0.1, -0.05, 0.2])
)
SMALL = Super4PcsConfig(hypotheses=3000)
seeds = st.integers(0, 2**31)


@cache
def small_index(seed: int = 0) -> PairIndex:
    generator = np.random.default_rng(seed)
    points, normals = generator.normal(size=(2, 25, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return PairIndex(0.05 * points, normals)


def placed_l(count: int) -> tuple[Array, Array]:
    """Points and normals of the L at `X_SO`: other ones than the index has."""
    points, normals = l_shape().surface_sample(count, seed=5)
    return transform_points(X_SO, points), normals @ X_SO[:3, :3].T


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
    config = Super4PcsConfig(delta=0.01, max_normal_angle=0.8)
    found = index.find(length, angles, config)
    pairs = set(zip(*found, strict=True))
    expected = set()
    for i in range(25):
        for j in range(25):
            p, q = index.points[[i, j]]
            if i == j or not abs(np.linalg.norm(q - p) - length) < config.delta:
                continue
            own = pair_angles(p, index.normals[i], q, index.normals[j])
            if np.abs(own - angles).max() < config.max_normal_angle:
                expected.add((i, j))
    assert pairs == expected


def test_poses_put_congruent_sets_on_their_bases(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls: list[tuple[Any, Any, Array]] = []
    original: Any = module._fit_sets

    def recorded(index: Any, bases: Any, sets: Any, config: Any) -> Array:
        poses = np.asarray(original(index, bases, sets, config))
        calls.append((bases, sets, poses))
        return poses

    monkeypatch.setattr(module, "_fit_sets", recorded)
    config = Super4PcsConfig(hypotheses=500)
    points, normals = placed_l(150)
    index = pair_index(l_shape())
    super4pcs(index, points, normals, np.random.default_rng(0), config)
    ((bases, sets, poses),) = calls
    assert len(poses) > 400
    least = np.full(len(poses), np.inf)
    for base, found in zip(bases, sets, strict=True):
        # Coplanar to within delta, as Super4PCS wants it, and wide.
        extents = np.linalg.svd(base.points - base.points.mean(axis=0))[1]
        assert extents[2] < config.delta
        assert extents[1] > 0.01
        for four in index.points[found]:
            put = transform_points(poses, four) - base.points
            rms = np.sqrt((put**2).sum(axis=2).mean(axis=1))
            least = np.minimum(least, rms)
    assert least.max() < 2 * config.delta


@pytest.mark.parametrize("seed", range(3))
def test_it_finds_the_pose_of_a_whole_surface(seed: int) -> None:
    points, normals = placed_l(150)
    poses = super4pcs(
        pair_index(l_shape()), points, normals, np.random.default_rng(seed), SMALL
    )
    assert 0.5 * SMALL.hypotheses < len(poses) <= SMALL.hypotheses
    field = registration_model(l_shape()).distance_field
    best = poses[int(lcp_scores(field, poses, points, normals, 0.006).argmax())]
    assert np.linalg.norm(best[:3, 3] - X_SO[:3, 3]) < 0.01
    assert np.degrees(rotation_angle(best[:3, :3].T @ X_SO[:3, :3])) < 8


def test_it_finds_the_pose_of_a_noisy_one_sided_view() -> None:
    made = synthesize(pair_apart(), noise=0.5)
    segment, X_true = made.scene().segments[0], made.X_SO[0]
    model = library()[GLUE]
    keep = np.random.default_rng(0).choice(len(segment.points), 140, replace=False)
    poses = super4pcs(
        pair_index(model),
        segment.points[keep],
        segment.normals[keep],
        np.random.default_rng(0),
        Super4PcsConfig(hypotheses=6000),
    )
    shifts = 1e3 * np.linalg.norm(poses[:, :3, 3] - X_true[:3, 3], axis=1)
    turns = np.degrees(
        model.symmetry.rotation_distance(
            poses[:, :3, :3], np.broadcast_to(X_true[:3, :3], (len(poses), 3, 3))
        )
    )
    assert ((shifts < 8) & (turns < 8)).sum() >= 3


def test_all_poses_are_rigid() -> None:
    points, normals = placed_l(100)
    poses = super4pcs(
        pair_index(l_shape()), points, normals, np.random.default_rng(0), SMALL
    )
    assert all(is_rotation(X[:3, :3], 1e-6) for X in poses)
    np.testing.assert_array_equal(poses[:, 3], np.tile([0, 0, 0, 1.0], (len(poses), 1)))


def test_the_same_seed_gives_the_same_poses() -> None:
    points, normals = placed_l(100)
    first, second, other = (
        super4pcs(
            pair_index(l_shape()), points, normals, np.random.default_rng(seed), SMALL
        )
        for seed in (1, 1, 2)
    )
    assert first.tobytes() == second.tobytes()
    assert first.tobytes() != other.tobytes()


@pytest.mark.parametrize("count", [0, 3])
def test_too_few_points_give_no_pose(count: int) -> None:
    points, normals = placed_l(100)
    poses = super4pcs(
        pair_index(l_shape()),
        points[:count],
        normals[:count],
        np.random.default_rng(0),
        SMALL,
    )
    assert poses.shape == (0, 4, 4)


def test_points_farther_apart_than_the_object_is_wide_give_no_pose() -> None:
    points = np.random.default_rng(0).permutation(27).reshape(-1, 1) @ np.ones((1, 3))
    normals = np.tile([0.0, 0.0, 1.0], (27, 1))
    poses = super4pcs(
        pair_index(l_shape()), points, normals, np.random.default_rng(0), SMALL
    )
    assert poses.shape == (0, 4, 4)
