# SPDX-License-Identifier: MIT
from __future__ import annotations

import logging
from functools import cache

import numpy as np
import pytest

from physim_drake.physics.settling import SettleConfig, Settler
from physim_drake.poses import Array, SymmetryGroup, make_pose
from tests.synthetic import (
    BALL,
    BOOK,
    COFFEE,
    ERASER,
    SOAP,
    TAPE,
    TISSUES,
    library,
    perturbed,
    pose_error,
    resting,
    turned,
)

FLAT = {
    ERASER: turned("z", 30),
    TAPE: turned("x", 90),
    TISSUES: turned("z", 10),
    SOAP: turned("yz", 90, 40),
    COFFEE: turned("x", 90),
}
ON_TISSUES = float(library()[TISSUES].extents[2])


@cache
def settler(free: int, *placed: int) -> Settler:
    return Settler(library()[free], [library()[k] for k in placed])


def tilt(X: Array, X_true: Array) -> float:
    return pose_error(X, X_true, SymmetryGroup())[1]


@pytest.mark.parametrize("object_id", FLAT)
def test_dropped_from_5_mm_it_rests_on_the_table(object_id: int) -> None:
    true = resting(object_id, FLAT[object_id], 0.1, -0.2)
    settled = settler(object_id).settle(make_pose(p=[0, 0, 0.005]) @ true, {})
    assert not settled.lost
    np.testing.assert_allclose(settled.X_SO[:3, 3], true[:3, 3], atol=3e-4)
    assert tilt(settled.X_SO, true) < 0.5


@pytest.mark.parametrize("object_id", FLAT)
def test_rest_is_noticed_although_a_body_may_chatter(object_id: int) -> None:
    true = resting(object_id, FLAT[object_id], 0.1, -0.2)
    settled = settler(object_id).settle(make_pose(p=[0, 0, 0.002]) @ true, {})
    assert settled.at_rest
    assert settled.time < 0.3


@pytest.mark.parametrize("depth", [0.001, 0.003, 0.01])
@pytest.mark.parametrize("object_id", FLAT)
def test_from_inside_the_table_it_comes_up_without_a_jump(
    object_id: int, depth: float
) -> None:
    true = resting(object_id, FLAT[object_id], 0.0, 0.0)
    settled = settler(object_id).settle(make_pose(p=[0, 0, -depth]) @ true, {})
    assert not settled.lost
    np.testing.assert_allclose(settled.X_SO[:3, 3], true[:3, 3], atol=1e-3)
    assert tilt(settled.X_SO, true) < 0.5


def test_a_tilted_box_falls_flat() -> None:
    true = resting(SOAP, FLAT[SOAP], 0.0, 0.0)
    tilted = make_pose(turned("x", 4)) @ true
    settled = settler(SOAP).settle(tilted, {})
    assert settled.X_SO[2, 3] == pytest.approx(true[2, 3], abs=5e-4)
    assert settled.X_SO[2, :3] == pytest.approx(true[2, :3], abs=0.01)


@pytest.mark.parametrize("gap", [0.005, -0.003])
def test_a_box_put_on_a_box_rests_on_it(gap: float) -> None:
    below = resting(TISSUES, np.eye(3), 0.0, 0.0)
    true = resting(SOAP, FLAT[SOAP], 0.02, 0.01, ON_TISSUES)
    start = make_pose(p=[0, 0, gap]) @ true
    settled = settler(SOAP, TISSUES).settle(start, {0: below})
    assert settled.at_rest
    np.testing.assert_allclose(settled.X_SO[:3, 3], true[:3, 3], atol=1e-3)
    assert tilt(settled.X_SO, true) < 1.0


def test_objects_that_are_not_placed_are_not_there() -> None:
    start = resting(SOAP, FLAT[SOAP], 0.02, 0.01, 0.01)
    alone = settler(SOAP, TISSUES).settle(start, {})
    expected = resting(SOAP, FLAT[SOAP], 0.02, 0.01)
    np.testing.assert_allclose(alone.X_SO[:3, 3], expected[:3, 3], atol=5e-4)


def test_a_box_over_an_edge_does_not_stay_in_the_air() -> None:
    below = resting(TISSUES, np.eye(3), 0.0, 0.0)
    edge = float(library()[TISSUES].extents[0]) / 2
    start = resting(SOAP, FLAT[SOAP], edge + 0.03, 0.0, ON_TISSUES)
    settled = settler(SOAP, TISSUES).settle(start, {0: below})
    assert settled.lost or settled.X_SO[2, 3] < start[2, 3] - 0.01


def test_the_ring_s_hole_is_open() -> None:
    ring = resting(TAPE, FLAT[TAPE], 0.0, 0.0)
    start = resting(BALL, np.eye(3), 0.0, 0.0, 0.001)
    settled = settler(BALL, TAPE).settle(start, {0: ring})
    # The hole is 7.6 cm wide, the ball 7 cm: it goes in and stands on the table.
    assert settled.X_SO[2, 3] == pytest.approx(0.035, abs=1e-3)
    assert np.linalg.norm(settled.X_SO[:2, 3]) < 0.006


def test_a_ball_does_not_roll_away() -> None:
    settled = settler(BALL).settle(resting(BALL, np.eye(3), 0.0, 0.0, 0.004), {})
    assert np.linalg.norm(settled.X_SO[:2, 3]) < 0.002


@pytest.mark.parametrize("height", [-2.0, 1.0])
def test_a_lost_object_is_reported(height: float) -> None:
    fast = SettleConfig(max_time=4.0, damping_time=10.0)
    settled = Settler(library()[SOAP], [], fast).settle(
        make_pose(p=[0.0, 0.0, height]), {}
    )
    assert settled.lost
    assert not settled.at_rest


def test_a_fall_is_followed_no_farther_than_asked() -> None:
    config = SettleConfig(lost_distance=0.05)
    start = resting(SOAP, FLAT[SOAP], 0.0, 0.0, 0.2)
    settled = Settler(library()[SOAP], [], config).settle(start, {})
    assert settled.lost
    assert 0.05 < start[2, 3] - settled.X_SO[2, 3] < 0.08
    assert not settler(SOAP).settle(start, {}).lost


def test_running_out_of_time_is_reported() -> None:
    hurried = Settler(library()[SOAP], [], SettleConfig(max_time=0.05))
    settled = hurried.settle(make_pose(p=[0.0, 0.0, 0.2]), {})
    assert not settled.at_rest
    assert not settled.lost
    assert settled.time == pytest.approx(0.05, abs=0.011)


def test_the_result_does_not_depend_on_what_was_settled_before() -> None:
    below = {0: resting(TISSUES, np.eye(3), 0.0, 0.0)}
    true = resting(SOAP, FLAT[SOAP], 0.02, 0.01, ON_TISSUES)
    one, other = (perturbed(true, 0.004, 0.05, seed) for seed in (1, 2))
    engine = settler(SOAP, TISSUES, BOOK)
    first = engine.settle(one, below)
    assert engine.settle(other, {}).X_SO.tobytes() != first.X_SO.tobytes()
    engine.settle(make_pose(p=[0, 0, -2.0]), {1: true})
    again = engine.settle(one, below)
    assert again.X_SO.tobytes() == first.X_SO.tobytes()
    assert again.time == first.time
    fresh = Settler(library()[SOAP], [library()[TISSUES], library()[BOOK]])
    assert fresh.settle(one, below).X_SO.tobytes() == first.X_SO.tobytes()


def test_the_start_is_not_written_to() -> None:
    start = resting(SOAP, FLAT[SOAP], 0.0, 0.0, 0.005)
    before = start.copy()
    settler(SOAP).settle(start, {})
    np.testing.assert_array_equal(start, before)


def test_drakes_remark_on_half_spaces_is_not_heard_and_others_are(
    caplog: pytest.LogCaptureFixture,
) -> None:
    drake = logging.getLogger("drake")
    with caplog.at_level(logging.WARNING, "drake"):
        before = list(drake.filters)
        Settler(library()[SOAP], [])
        assert caplog.messages == []
        assert drake.filters == before
        drake.warning("half spaces are not what you think")
    assert len(caplog.messages) == 1
