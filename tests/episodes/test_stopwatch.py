# SPDX-License-Identifier: MIT
from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from physim_drake.episodes import stopwatch
from physim_drake.episodes.stopwatch import Stopwatch, TimedPlanner
from physim_drake.scene_estimate import SceneEstimate
from tests.picking.fakes import FakePlanner
from tests.picking.scenes import estimate_of


class Clock:
    """A clock that goes on only when it is told to."""

    def __init__(self) -> None:
        self.now = 100.0


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(stopwatch, "time", SimpleNamespace(monotonic=lambda: clock.now))
    return clock


def test_a_stage_is_taken_from_the_lap_around_it(clock: Clock) -> None:
    watch = Stopwatch()
    clock.now += 1.0
    with watch.stage("sleeping"):
        clock.now += 5.0
    clock.now += 2.0
    watch.lap("waking")
    assert watch.seconds == {"sleeping": 5.0, "waking": 3.0}


def test_a_stage_within_a_stage_counts_once(clock: Clock) -> None:
    watch = Stopwatch()
    with watch.stage("outer"), watch.stage("inner"):
        clock.now += 2.0
    assert watch.seconds == {"outer": 2.0}


def test_a_stage_that_fails_is_booked_and_left(clock: Clock) -> None:
    def fail(watch: Stopwatch) -> None:
        with watch.stage("work"):
            clock.now += 2.0
            raise ValueError("bad")

    watch = Stopwatch()
    with pytest.raises(ValueError, match="bad"):
        fail(watch)
    with watch.stage("work"):
        clock.now += 1.0
    assert watch.seconds == {"work": 3.0}


def test_a_restart_forgets_what_was_booked(clock: Clock) -> None:
    watch = Stopwatch()
    with watch.stage("work"):
        clock.now += 2.0
    watch.restart()
    watch.lap("rest")
    assert watch.seconds == {"rest": 0.0}


def test_a_timed_planner_plans_as_the_other_and_books_it(clock: Clock) -> None:
    class Slow(FakePlanner):
        def set_scene(self, estimate: SceneEstimate) -> None:
            clock.now += 4.0

    slow, watch = Slow(), Stopwatch()
    timed = TimedPlanner(slow, watch)
    timed.set_scene(estimate_of([]))
    way = timed.plan_look(np.zeros(1), np.eye(4))
    assert watch.seconds == {"planning": 4.0}
    np.testing.assert_array_equal(way.q, slow.plan_look(np.zeros(1), np.eye(4)).q)
