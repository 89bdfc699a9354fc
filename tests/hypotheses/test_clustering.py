# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from physim_drake.hypotheses.clustering import ClusteringConfig, cluster_poses
from physim_drake.poses import Array, ContinuousAxis, SymmetryGroup

NONE = SymmetryGroup()
BALL = SymmetryGroup(axes=tuple(ContinuousAxis(a, np.zeros(3)) for a in np.eye(3)))
seeds = st.integers(0, 2**31)


def poses_near(
    R: Rotation,
    p: list[float],
    count: int,
    generator: np.random.Generator,
    shift: float = 0.004,
    angle: float = np.radians(3),
) -> Array:
    """Poses (count, 4, 4) scattered about one."""
    X = np.tile(np.eye(4), (count, 1, 1))
    turns = Rotation.from_rotvec(angle * generator.normal(size=(count, 3)))
    X[:, :3, :3] = (turns * R).as_matrix()
    X[:, :3, 3] = p + shift * generator.normal(size=(count, 3))
    return X


def chosen(
    X: Array, weights: Array, symmetry: SymmetryGroup = NONE, seed: int = 0
) -> Array:
    return np.asarray(cluster_poses(X, weights, symmetry, np.random.default_rng(seed)))


@settings(max_examples=20, deadline=None)
@given(seeds, st.integers(1, 300))
def test_representatives_are_at_most_25_different_members(
    seed: int, count: int
) -> None:
    generator = np.random.default_rng(seed)
    X = poses_near(Rotation.identity(), [0, 0, 0], count, generator, 0.02, 1.0)
    indices = chosen(X, generator.uniform(0.01, 1, count))
    assert 0 < len(indices) <= min(25, count)
    assert len(set(indices.tolist())) == len(indices)
    assert 0 <= indices.min() <= indices.max() < count


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("few", [True, False], ids=["1 % of them", "1 % of the weight"])
@pytest.mark.parametrize("apart", ["translation", "rotation"])
def test_a_mode_of_one_percent_is_represented(apart: str, few: bool, seed: int) -> None:
    generator = np.random.default_rng(seed)
    if apart == "translation":
        other, p = Rotation.identity(), [0.1, 0.0, 0.0]
    else:
        other, p = Rotation.from_euler("x", 90, degrees=True), [0.0, 0.0, 0.0]
    counts = (990, 10) if few else (500, 500)
    X = np.concatenate(
        [
            poses_near(Rotation.identity(), [0, 0, 0], counts[0], generator),
            poses_near(other, p, counts[1], generator),
        ]
    )
    weights = np.ones(len(X))
    if not few:
        weights[counts[0] :] = 0.01
    indices = chosen(X, weights, seed=seed)
    assert (indices < counts[0]).any()
    assert (indices >= counts[0]).any()


def test_rotations_all_over_are_covered() -> None:
    generator = np.random.default_rng(0)
    X = poses_near(Rotation.identity(), [0, 0, 0], 600, generator, 0.001)
    X[:, :3, :3] = Rotation.from_euler(
        "z", generator.uniform(0, 360, (600, 1)), degrees=True
    ).as_matrix()
    indices = chosen(X, np.ones(600))
    distances = NONE.rotation_distance(X[:, :3, :3], X[indices, :3, :3], pairwise=True)
    assert np.degrees(distances.min(axis=1).max()) < 40


def test_equivalent_rotations_share_a_representative() -> None:
    generator = np.random.default_rng(0)
    half_turn = Rotation.from_euler("z", 180, degrees=True)
    quarter = Rotation.from_euler("x", 90, degrees=True)
    X = np.concatenate(
        [
            poses_near(R, [0, 0, 0], 100, generator, 1e-4, 1e-3)
            for R in (Rotation.identity(), half_turn, quarter)
        ]
    )
    turned = np.eye(4)
    turned[:3, :3] = half_turn.as_matrix()
    symmetric = SymmetryGroup(np.stack([np.eye(4), turned]))
    config = ClusteringConfig(representatives=2, translation_clusters=1)
    indices = cluster_poses(
        X, np.ones(300), symmetric, np.random.default_rng(0), config
    )
    modes = [int(i) // 100 for i in indices]
    # The first two modes look the same and weigh twice as much as the third.
    assert modes[0] in (0, 1)
    assert modes[1:] == [2]


@pytest.mark.parametrize("seed", range(5))
def test_as_many_representatives_as_modes_take_one_of_each(seed: int) -> None:
    generator = np.random.default_rng(seed)
    X = np.concatenate(
        [
            poses_near(
                Rotation.from_euler("x", 60 * n, degrees=True),
                [0, 0, 0],
                60,
                generator,
                1e-4,
                1e-3,
            )
            for n in range(5)
        ]
    )
    config = ClusteringConfig(representatives=5, translation_clusters=1)
    indices = cluster_poses(X, np.ones(300), NONE, generator, config)
    assert sorted(int(i) // 60 for i in indices) == [0, 1, 2, 3, 4]


def test_a_ball_s_rotations_are_one() -> None:
    generator = np.random.default_rng(0)
    X = poses_near(Rotation.identity(), [0, 0, 0], 400, generator, 0.0)
    X[:, :3, :3] = Rotation.random(400, rng=generator).as_matrix()
    assert len(chosen(X, np.ones(400), BALL)) == 1


def test_the_heavier_mode_comes_first() -> None:
    generator = np.random.default_rng(0)
    X = np.concatenate(
        [
            poses_near(Rotation.identity(), [0, 0, 0], 100, generator, 1e-4, 1e-3),
            poses_near(Rotation.identity(), [0.2, 0, 0], 100, generator, 1e-4, 1e-3),
        ]
    )
    weights = np.concatenate([np.full(100, 0.1), np.full(100, 1.0)])
    config = ClusteringConfig(representatives=2, translation_clusters=2)
    indices = cluster_poses(X, weights, NONE, generator, config)
    assert [int(i) // 100 for i in indices] == [1, 0]


def test_a_representative_lies_amid_its_cluster() -> None:
    generator = np.random.default_rng(0)
    X = poses_near(Rotation.identity(), [0, 0, 0], 300, generator, 1e-4)
    config = ClusteringConfig(representatives=1, translation_clusters=1)
    (index,) = cluster_poses(X, np.ones(300), NONE, generator, config)
    from_identity = NONE.rotation_distance(X[:, :3, :3], np.eye(3))
    assert from_identity[index] < np.percentile(from_identity, 20)


def test_the_same_seed_gives_the_same_choice() -> None:
    generator = np.random.default_rng(4)
    X = poses_near(Rotation.identity(), [0, 0, 0], 500, generator, 0.03, 1.0)
    weights = generator.uniform(0.1, 1, 500)
    np.testing.assert_array_equal(
        chosen(X, weights, seed=3), chosen(X, weights, seed=3)
    )
    assert chosen(X, weights, seed=3).tolist() != chosen(X, weights, seed=4).tolist()


def test_copies_of_one_pose_are_one() -> None:
    X = np.tile(np.eye(4), (100, 1, 1))
    assert len(chosen(X, np.ones(100))) == 1


def test_no_more_than_wanted_are_all_kept_best_first() -> None:
    X = poses_near(Rotation.identity(), [0, 0, 0], 4, np.random.default_rng(0))
    assert chosen(X, np.array([0.1, 0.4, 0.2, 0.3])).tolist() == [1, 3, 2, 0]
