# SPDX-License-Identifier: MIT
from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from physim_drake.hypotheses.generation import (
    HypothesisConfig,
    PoseHypotheses,
    generate_hypotheses,
)
from physim_drake.hypotheses.super4pcs import Super4PcsConfig
from physim_drake.observation.segmented_scene import SegmentedScene
from tests.synthetic import (
    GLUE,
    SOAP,
    SyntheticScene,
    library,
    pair_apart,
    pose_error,
    synthesize,
)

QUICK = HypothesisConfig(super4pcs=Super4PcsConfig(hypotheses=5000), polished=500)


@cache
def made() -> SyntheticScene:
    return synthesize(pair_apart(), noise=0.5)


@cache
def scene() -> SegmentedScene:
    return made().scene()


def hypotheses(k: int, seed: int = 0, count: int | None = None) -> PoseHypotheses:
    segment = scene().segments[k]
    return generate_hypotheses(
        library()[segment.object_id],
        scene(),
        segment.points[:count],
        segment.normals[:count],
        np.random.default_rng(seed),
        QUICK,
    )


@pytest.mark.parametrize(("k", "object_id"), [(0, GLUE), (1, SOAP)])
def test_a_representative_is_near_the_truth(k: int, object_id: int) -> None:
    found = hypotheses(k)
    errors = np.array(
        [
            pose_error(X, made().X_SO[k], library()[object_id].symmetry)
            for X in found.poses
        ]
    )
    assert found.object_id == object_id
    assert ((errors[:, 0] < 6) & (errors[:, 1] < 8)).any()


def test_representatives_are_few_members_best_first() -> None:
    found = hypotheses(0)
    assert 1 < len(found.representatives) <= 25
    assert len(set(found.representatives.tolist())) == len(found.representatives)
    np.testing.assert_array_equal(found.poses, found.X_SO[found.representatives])
    assert (np.diff(found.scores) <= 0).all()
    assert ((found.lcp >= 0) & (found.lcp <= 1)).all()
    assert len(found.lcp) == len(found.X_SO) == QUICK.super4pcs.hypotheses


def test_representatives_are_spread() -> None:
    R = hypotheses(0).poses[:, :3, :3]
    angles = library()[GLUE].symmetry.rotation_distance(R, R, pairwise=True)
    assert np.degrees(angles).max() > 45


def test_the_same_seed_gives_the_same_hypotheses() -> None:
    first, second, other = hypotheses(1, 1), hypotheses(1, 1), hypotheses(1, 2)
    assert first.X_SO.tobytes() == second.X_SO.tobytes()
    assert first.representatives.tolist() == second.representatives.tolist()
    assert first.X_SO.tobytes() != other.X_SO.tobytes()


@pytest.mark.parametrize("count", [0, 3])
def test_too_small_a_segment_gives_none(count: int) -> None:
    found = hypotheses(0, count=count)
    assert found.X_SO.shape == (0, 4, 4)
    assert found.poses.shape == (0, 4, 4)
    assert found.scores.shape == (0,)
