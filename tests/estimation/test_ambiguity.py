# SPDX-License-Identifier: MIT
from __future__ import annotations

import math
import time
from functools import cache

import numpy as np
import pytest
import trimesh

from physim_drake.estimation.ambiguity import confidence_shares
from physim_drake.objects.model import ObjectModel
from physim_drake.poses import Array, make_pose
from tests.synthetic import BALL, SOAP, l_shape, library, turned

HERE = make_pose(turned("xyz", 20, -30, 40), [0.1, 0.2, 0.05])
TIE = 0.01
COST = 1000.0


@cache
def box() -> ObjectModel:
    """A box, whose half turns about its axes are symmetries."""
    return ObjectModel.from_mesh(2, "box", trimesh.creation.box([0.1, 0.06, 0.03]))


@cache
def can() -> ObjectModel:
    """A cylinder about z."""
    return ObjectModel.from_mesh(3, "can", trimesh.creation.cylinder(0.03, 0.1))


def moved(degrees: float = 0.0, shift: float = 0.0) -> Array:
    """`HERE` turned about the object's z and shifted along it."""
    return HERE @ make_pose(turned("z", degrees), [0.0, 0.0, shift])


def share(others: list[tuple[Array, float]], model: ObjectModel | None = None) -> float:
    """What the object at `HERE` keeps beside states with it elsewhere."""
    tried = [({0: X}, cost) for X, cost in [(HERE, COST), *others]]
    models = {0: model or l_shape()}
    return confidence_shares({0: HERE}, COST, tried, models, TIE)[0]


def test_a_pose_without_another_keeps_its_confidence() -> None:
    assert share([]) == 1
    assert confidence_shares({0: HERE}, COST, [], {0: l_shape()}, TIE) == {0: 1}


def test_poses_that_tie_share() -> None:
    assert share([(moved(180), COST)]) == pytest.approx(1 / 2)
    assert share([(moved(180), COST), (moved(90), COST)]) == pytest.approx(1 / 3)


def test_the_share_grows_with_the_gap_of_the_costs() -> None:
    gaps = [0.0, 2.0, 10.0, 30.0, 100.0]
    shares = [share([(moved(180), COST + gap)]) for gap in gaps]
    wanted = [1 / (1 + math.exp(-gap / (TIE * COST))) for gap in gaps]
    assert shares == pytest.approx(wanted, abs=1e-3)
    assert shares == sorted(shares)
    assert shares[-1] == 1


def test_a_state_that_lost_within_a_tie_counts_no_more_than_the_estimate() -> None:
    assert share([(moved(180), 0.995 * COST)]) == pytest.approx(1 / 2)


@pytest.mark.parametrize(
    ("degrees", "shift", "kept"),
    [(4.0, 0.0, 1), (6.0, 0.0, 0.5), (0.0, 0.009, 1), (0.0, 0.011, 0.5)],
)
def test_poses_within_5_degrees_and_1_cm_are_one(
    degrees: float, shift: float, kept: float
) -> None:
    assert share([(moved(degrees, shift), COST)]) == pytest.approx(kept)


def test_each_other_pose_counts_once_at_its_least_cost() -> None:
    many = [(moved(180 + d), COST + gap) for d, gap in [(0, 20), (2, 5), (3, 10)]]
    once = share([(moved(182), COST + 5)])
    assert once < 0.7
    assert share(many) == pytest.approx(once)
    assert share(many[::-1]) == pytest.approx(once)


def test_symmetric_poses_do_not_share() -> None:
    assert share([(moved(180), COST)], box()) == 1
    assert share([(moved(180), COST), (moved(90), COST)], box()) == pytest.approx(0.5)
    assert share([(moved(d), COST) for d in (25, 97, 190)], can()) == 1
    assert share([(moved(70), COST)], library()[BALL]) == 1


def test_only_the_object_that_differs_shares() -> None:
    there = moved(shift=0.3)
    best = {0: HERE, 1: there}
    other = {0: moved(180), 1: there}
    models = {0: l_shape(), 1: library()[SOAP]}
    shares = confidence_shares(best, COST, [(best, COST), (other, COST)], models, TIE)
    assert shares == {0: pytest.approx(1 / 2), 1: 1}


def test_objects_of_a_kind_that_change_places_do_not_share() -> None:
    there = moved(30, 0.3)
    best, swapped = {0: HERE, 1: there}, {0: there, 1: HERE}
    tried = [(best, COST), (swapped, COST)]
    same = dict.fromkeys(best, l_shape())
    assert confidence_shares(best, COST, tried, same, TIE) == {0: 1, 1: 1}
    differing = {0: l_shape(), 1: library()[SOAP]}
    apart = confidence_shares(best, COST, tried, differing, TIE)
    assert apart == {0: pytest.approx(1 / 2), 1: pytest.approx(1 / 2)}


def test_no_cost_and_no_tie_are_no_error() -> None:
    tried = [({0: moved(180)}, 0.0), ({0: moved(90)}, 5.0)]
    shares = confidence_shares({0: HERE}, 0.0, tried, {0: l_shape()}, TIE)
    assert shares[0] == pytest.approx(1 / 2)
    none = confidence_shares({0: HERE}, 4.0, [({0: moved(9)}, 5.0)], {0: box()}, 0.0)
    assert none == {0: 1}


def test_sharing_takes_no_time_that_counts() -> None:
    rng = np.random.default_rng(0)
    states = [
        ({k: moved(rng.uniform(0, 360), k / 3) for k in range(4)}, COST)
        for _ in range(16)
    ]
    models = dict.fromkeys(range(4), box())
    start = time.process_time()
    confidence_shares(states[0][0], COST, states, models, TIE)
    assert time.process_time() - start < 2
