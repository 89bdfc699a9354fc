# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physim_drake.hypotheses.bases import Bases, draw_bases
from physim_drake.hypotheses.pairs import PairIndex, Points, pair_angles, pair_index
from physim_drake.hypotheses.rigid_fit import fit_sets
from physim_drake.hypotheses.super4pcs import (
    Super4PcsConfig,
    congruent_sets,
    super4pcs,
)
from physim_drake.poses import (
    Array,
    is_rotation,
    make_pose,
    rotation_angle,
    transform_points,
)
from physim_drake.registration.registration_model import registration_model
from physim_drake.registration.trimmed_icp import lcp_scores
from tests.synthetic import GLUE, l_shape, library, pair_apart, synthesize

X_SO = make_pose(
    Rotation.from_rotvec([0.3, -0.8, 1.2]).as_matrix(), np.array([0.1, -0.05, 0.2])
)
SMALL = Super4PcsConfig(hypotheses=3000)
CONFIG = Super4PcsConfig()


def placed_l(count: int) -> tuple[Array, Array]:
    """Points and normals of the L at `X_SO`: other ones than the index has."""
    points, normals = l_shape().surface_sample(count, seed=5)
    return transform_points(X_SO, points), normals @ X_SO[:3, :3].T


@cache
def bases() -> Bases:
    points, _ = placed_l(150)
    return draw_bases(points, 0.14, CONFIG.delta, 60, np.random.default_rng(0))


def test_congruent_sets_have_the_base_s_diagonals_and_normals() -> None:
    points, normals = placed_l(150)
    index = pair_index(l_shape())
    total = 0
    for corners, ratios, angle in zip(
        bases().corners, bases().ratios, bases().angles, strict=True
    ):
        base = points[corners]
        sets = congruent_sets(index, base, normals[corners], ratios, angle, CONFIG)
        total += len(sets)
        a, b, c, d = np.moveaxis(index.points[sets], 1, 0)
        for k, (p, q) in enumerate(((a, b), (c, d))):
            length = np.linalg.norm(base[2 * k + 1] - base[2 * k])
            found = np.linalg.norm(q - p, axis=1)
            np.testing.assert_allclose(found, length, atol=CONFIG.delta)
        gap = a + ratios[0] * (b - a) - c - ratios[1] * (d - c)
        assert (np.linalg.norm(gap, axis=1) < CONFIG.delta).all()
        for own, wanted in (
            (pair_angles(a, n_O(sets, 0), b, n_O(sets, 1)), (0, 1)),
            (pair_angles(c, n_O(sets, 2), d, n_O(sets, 3)), (2, 3)),
        ):
            i, j = corners[list(wanted)]
            angles = pair_angles(points[i], normals[i], points[j], normals[j])
            assert (np.abs(own - angles) < CONFIG.max_normal_angle).all()
    assert total > 2000


def n_O(sets: Points, k: int) -> Array:
    return np.asarray(pair_index(l_shape()).normals[sets[:, k]])


def test_no_congruent_set_is_missed() -> None:
    points, normals = placed_l(150)
    full = pair_index(l_shape())
    few = np.random.default_rng(0).choice(len(full.points), 60, replace=False)
    index = PairIndex(full.points[few], full.normals[few])
    # All pairs against all, for the three first bases.
    for corners, ratios, angle in zip(
        bases().corners[:3], bases().ratios[:3], bases().angles[:3], strict=True
    ):
        p, n = points[corners], normals[corners]
        ends = []
        for k in (0, 2):
            length = float(np.linalg.norm(p[k + 1] - p[k]))
            angles = pair_angles(p[k], n[k], p[k + 1], n[k + 1])
            ends.append(
                np.stack(
                    index.find(length, angles, CONFIG.delta, CONFIG.max_normal_angle)
                )
            )
        (a, b), (c, d) = (index.points[e][:, :, None] for e in ends)
        c, d = np.swapaxes(c, 0, 1), np.swapaxes(d, 0, 1)
        gap = a + ratios[0] * (b - a) - c - ratios[1] * (d - c)
        cosine = ((b - a) * (d - c)).sum(axis=2)
        cosine /= np.linalg.norm(b - a, axis=2) * np.linalg.norm(d - c, axis=2)
        right = np.abs(np.arccos(cosine) - angle) < CONFIG.max_set_angle
        rows, columns = np.nonzero((np.linalg.norm(gap, axis=2) < CONFIG.delta) & right)
        expected = np.concatenate([ends[0][:, rows], ends[1][:, columns]]).T
        config = replace(CONFIG, max_pairs=10**6, sets_per_base=10**6)
        found = congruent_sets(index, p, n, ratios, angle, config)
        assert {tuple(s) for s in found} == {tuple(s) for s in expected}
        assert len(found) == len(expected)


def test_poses_put_congruent_sets_on_their_bases() -> None:
    points, normals = placed_l(150)
    index = pair_index(l_shape())
    total = 0
    for corners, ratios, angle in zip(
        bases().corners, bases().ratios, bases().angles, strict=True
    ):
        base = points[corners], normals[corners]
        sets = congruent_sets(index, *base, ratios, angle, CONFIG)
        poses = np.zeros((len(sets), 4, 4))
        fits = fit_sets(*base, index.points, index.normals, sets, 0.01, poses)
        total += fits
        for X in poses[:fits]:
            residual = transform_points(X, index.points[sets.ravel()]).reshape(-1, 4, 3)
            squares = np.square(residual - base[0]).sum(axis=2)
            assert np.sqrt(squares.mean(axis=1)).min() < 0.01
    assert total > 1000


def test_poor_fits_and_what_is_too_much_are_left_out() -> None:
    points, normals = placed_l(150)
    index = pair_index(l_shape())
    corners, ratios = bases().corners[0], bases().ratios[0]
    base = points[corners], normals[corners]
    sets = congruent_sets(index, *base, ratios, bases().angles[0], CONFIG)
    poses = np.zeros((len(sets), 4, 4))

    def fits(max_rms: float, room: int) -> int:
        model = index.points, index.normals
        return int(fit_sets(*base, *model, sets, max_rms, poses[:room]))

    assert 0 < fits(0.003, len(sets)) < fits(0.01, len(sets)) <= len(sets)
    assert fits(0.01, 2) == 2
    assert fits(0.01, 0) == 0


@pytest.mark.parametrize("seed", range(3))
def test_it_finds_the_pose_of_a_whole_surface(seed: int) -> None:
    points, normals = placed_l(150)
    poses = super4pcs(
        pair_index(l_shape()), points, normals, np.random.default_rng(seed), SMALL
    )
    assert len(poses) == SMALL.hypotheses
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
