# SPDX-License-Identifier: MIT
"""Wall time of an episode, by stage."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from physim_drake.picking.arm_planner import PickPlan
from physim_drake.picking.pick_choice import MotionPlanner
from physim_drake.picking.planner_config import HeldObject
from physim_drake.picking.policy import PickCandidate
from physim_drake.picking.trajectories import ArmTrajectory
from physim_drake.poses import Array
from physim_drake.scene_estimate import SceneEstimate


class Stopwatch:
    """Books wall time under stages.

    Laps follow each other. A stage may interrupt a lap, which is then shorter by it.

    Attributes:
        seconds: booked so far, by stage.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._inside = False
        self._booked = 0.0
        self._last = time.monotonic()

    def restart(self) -> None:
        """Forgets everything and begins the first lap."""
        self.seconds, self._booked, self._last = {}, 0.0, time.monotonic()

    def lap(self, stage: str) -> None:
        """Books the time since the last lap, less what stages took of it."""
        now = time.monotonic()
        self._book(stage, now - self._last - self._booked)
        self._last, self._booked = now, 0.0

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Books what happens within, unless a stage around this one does."""
        if self._inside:
            yield
            return
        self._inside, begin = True, time.monotonic()
        try:
            yield
        finally:
            self._inside = False
            taken = time.monotonic() - begin
            self._booked += taken
            self._book(name, taken)

    def _book(self, stage: str, seconds: float) -> None:
        self.seconds[stage] = self.seconds.get(stage, 0.0) + seconds


class TimedPlanner:
    """A `MotionPlanner` that books the calls of another one.

    Args:
        planner: does the planning.
        watch: books it.
        stage: name of the stage it is booked under.
    """

    def __init__(
        self, planner: MotionPlanner, watch: Stopwatch, stage: str = "planning"
    ) -> None:
        self._planner, self._watch, self._stage = planner, watch, stage

    def set_scene(self, estimate: SceneEstimate) -> None:
        """See `MotionPlanner`."""
        with self._watch.stage(self._stage):
            self._planner.set_scene(estimate)

    def plan_look(self, q_now: Array, X_WC: Array) -> ArmTrajectory:
        """See `MotionPlanner`."""
        with self._watch.stage(self._stage):
            return self._planner.plan_look(q_now, X_WC)

    def plan_pick(self, q_now: Array, candidate: PickCandidate) -> PickPlan:
        """See `MotionPlanner`."""
        with self._watch.stage(self._stage):
            return self._planner.plan_pick(q_now, candidate)

    def plan_place(
        self, q_now: Array, X_WG_place: Array, held: HeldObject
    ) -> ArmTrajectory:
        """See `MotionPlanner`."""
        with self._watch.stage(self._stage):
            return self._planner.plan_place(q_now, X_WG_place, held)

    def plan_line(
        self, q_now: Array, shift_W: Array, held: HeldObject | None
    ) -> ArmTrajectory:
        """See `MotionPlanner`."""
        with self._watch.stage(self._stage):
            return self._planner.plan_line(q_now, shift_W, held)
