# SPDX-License-Identifier: MIT
from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from physim_drake.hypotheses.visibility import visibility
from physim_drake.observation.segmented_scene import SegmentedScene
from physim_drake.poses import Array, make_pose
from physim_drake.registration.registration_model import registration_model
from tests.synthetic import (
    BOOK,
    GLUE,
    SOAP,
    TISSUES,
    SyntheticScene,
    library,
    pair_apart,
    resting,
    synthesize,
    turned,
)


@cache
def made() -> SyntheticScene:
    return synthesize(pair_apart(), noise=0.5)


@cache
def scene() -> SegmentedScene:
    return made().scene()


def seen(object_id: int, X_SO: Array, scene: SegmentedScene) -> float:
    return float(
        visibility(registration_model(library()[object_id]), X_SO[None], scene)[0]
    )


@pytest.mark.parametrize(("k", "object_id"), [(0, GLUE), (1, SOAP)])
def test_the_true_pose_is_confirmed(k: int, object_id: int) -> None:
    assert seen(object_id, made().X_SO[k], scene()) > 0.95


@pytest.mark.parametrize("height", [0.04, 0.1, -0.03, -0.08])
@pytest.mark.parametrize(("k", "object_id"), [(0, GLUE), (1, SOAP)])
def test_floating_and_sunk_poses_are_refuted(
    k: int, object_id: int, height: float
) -> None:
    assert seen(object_id, make_pose(p=[0, 0, height]) @ made().X_SO[k], scene()) < 0.6


@pytest.mark.parametrize("height", [0.08, -0.08])
def test_far_from_the_surface_nothing_is_confirmed(height: float) -> None:
    assert seen(SOAP, make_pose(p=[0, 0, height]) @ made().X_SO[1], scene()) < 0.1


def test_more_height_is_less_confirmed() -> None:
    moves = np.stack([make_pose(p=[0, 0, 0.01 * n]) for n in range(6)])
    model = registration_model(library()[SOAP])
    scores = visibility(model, moves @ made().X_SO[1], scene())
    assert (np.diff(scores) < 0.05).all()
    assert scores[0] - scores[-1] > 0.8


def test_behind_the_camera_is_refuted() -> None:
    behind = make_pose(p=[0.0, -2.0, 1.0])
    assert seen(SOAP, behind @ made().X_SO[1], scene()) == 0


def test_what_is_hidden_does_not_count() -> None:
    behind = resting(SOAP, turned("yz", 90, 10), 0.03, 0.09)
    before = resting(TISSUES, np.eye(3), 0.0, -0.02)
    made = synthesize([(SOAP, behind), (TISSUES, before)], noise=0.5)
    visible = made.masks[0].sum()
    alone = synthesize([(SOAP, behind)]).masks[0].sum()
    assert 0.1 * alone < visible < 0.7 * alone
    assert seen(SOAP, made.X_SO[0], made.scene()) > 0.9


def test_an_object_too_large_for_the_gap_is_refuted() -> None:
    # A book where the bar of soap lies sticks out over the table.
    X = resting(BOOK, turned("yz", 90, 60), 0.08, 0.02, 0.025)
    made_X = np.linalg.inv(made().surface.X_WS) @ X
    assert seen(BOOK, made_X, scene()) < 0.5
