# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest

from physim_drake.picking.arm_planner import drop_pose
from physim_drake.picking.planner_config import HeldObject
from physim_drake.picking.tote import Tote
from physim_drake.poses import make_pose, transform_points
from tests.synthetic import BALL, TISSUES, library

DROPS = np.array([[2.0, 0.0, 0.75], [2.07, 0.0, 0.75], [1.8, 0.0, 0.75]])
TOTE = Tote(make_pose(p=[2.0, 0.0, 0.75]), np.array([0.2, 0.15]), DROPS, 0.05)


@pytest.mark.parametrize(
    ("p_W", "inside"),
    [
        ([2.0, 0.0, 0.78], True),
        ([2.19, 0.14, 1.0], True),
        ([2.21, 0.0, 0.78], False),
        ([2.0, 0.16, 0.78], False),
        ([2.0, 0.0, 0.5], False),
        ([2.0, 0.0, 1.3], False),
    ],
)
def test_only_what_is_over_its_floor_is_in_it(p_W: list[float], inside: bool) -> None:
    assert TOTE.holds(np.array(p_W)) is inside


def test_it_is_filled_evenly() -> None:
    assert TOTE.order(TOTE.empty) == [0, 1, 2]
    assert TOTE.order((0.1, 0.0, 0.05)) == [1, 2, 0]


def test_nothing_is_carried_lower_than_what_lies_there_reaches() -> None:
    assert TOTE.release_point(0, TOTE.empty) == pytest.approx([2.0, 0.0, 0.80])
    fills = (0.1, 0.0, 0.05)
    for drop in range(3):
        height = TOTE.release_point(drop, fills)[2] - 0.75
        assert height == pytest.approx(0.1 + 0.03)


def test_nothing_is_lowered_to_above_where_it_was_carried() -> None:
    assert TOTE.over(0, TOTE.empty)[2] == pytest.approx(0.75 + 0.2)
    full = (0.5, 0.0, 0.0)
    assert TOTE.release_point(1, full) == pytest.approx(TOTE.over(1, full))


def test_an_object_raises_the_drops_it_covers_by_its_height() -> None:
    ball, height = library()[BALL], float(library()[BALL].extents[2])
    held = HeldObject(BALL, make_pose(p=[0.0, 0.0, height / 2]))
    assert TOTE.filled(TOTE.empty, 0, held, library()) == pytest.approx(
        (height, 0.0, 0.0), abs=1e-6
    )
    assert ball.diameter / 2 < 0.07  # so that it does not reach the next drop
    wide = HeldObject(TISSUES, make_pose())
    fills = TOTE.filled((0.0, 0.02, 0.0), 0, wide, library())
    assert fills[0] > 0
    assert fills[1] == max(fills[0], 0.02)


def test_what_is_carried_there_stays_above_what_is_in_it() -> None:
    held = HeldObject(BALL, make_pose(p=[0.0, 0.0, 0.04]))
    fills = TOTE.filled(TOTE.empty, 0, held, library())
    p_WD = TOTE.release_point(0, fills)
    X_WG = drop_pose(library(), held, p_WD)
    points = transform_points(X_WG @ held.X_GO, library()[BALL].mesh.vertices)
    assert points[:, 2].min() >= DROPS[0, 2] + fills[0] - 1e-9
