# SPDX-License-Identifier: MIT
"""The memory of the pick task: small frozen values, so that a copy is a snapshot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum

from physim_drake.picking.pick_choice import PickAndPlace
from physim_drake.picking.scene_memory import NOTHING_KNOWN
from physim_drake.picking.tote import Fills
from physim_drake.picking.trajectories import ArmTrajectory
from physim_drake.poses import Array
from physim_drake.scene_estimate import SceneEstimate


class Phase(StrEnum):
    """What the cell is doing."""

    LOOK = "look"
    SETTLE = "settle"
    ESTIMATE = "estimate"
    REACH = "reach"
    APPROACH = "approach"
    SEAL = "seal"
    LIFT = "lift"
    CARRY = "carry"
    LOWER = "lower"
    RELEASE = "release"
    RETREAT = "retreat"
    DONE = "done"


class EventKind(StrEnum):
    """Kinds of entries of the log."""

    LOOK = "look"
    ESTIMATE = "estimate"
    NO_ESTIMATE = "no estimate"
    LOOK_AGAIN = "look again"
    NO_PLAN = "no plan"
    PICK = "pick"
    NO_SEAL = "no seal"
    DROPPED = "dropped"
    PLACED = "placed"
    GIVEN_UP = "given up"
    END = "end"


@dataclass(frozen=True)
class TaskEvent:
    """An entry of the task's log.

    Attributes:
        time: simulated time, s.
        kind: kind of event.
        text: description of what happened and why.
        name: name of the object, if it is about one.
    """

    time: float
    kind: EventKind
    text: str
    name: str = ""


@dataclass(frozen=True)
class Motion:
    """A trajectory that is being executed, perhaps brought to a stop on the way.

    Attributes:
        trajectory: trajectory of the planned joints.
        start: time at which it begins, s.
        stop: time from which on it slows down, s; None if it runs to its end.
        stop_time: time that slowing down takes, s.
    """

    trajectory: ArmTrajectory
    start: float
    stop: float | None = None
    stop_time: float = 0.25

    @property
    def end(self) -> float:
        """When the arm stands, s."""
        if self.stop is None:
            return self.start + self.trajectory.duration
        return min(self.start + self.trajectory.duration, self.stop + self.stop_time)

    def stopped(self, time: float) -> Motion:
        """The same motion, brought to a stop from `time` on."""
        return replace(self, stop=max(time, self.start))

    def reference(self, time: float) -> tuple[Array, Array]:
        """Joint angles (n,) and velocities (n,) at a time, s."""
        local, rate = time - self.start, 1.0
        if self.stop is not None and time > self.stop:
            # The rate at which the trajectory is run through falls evenly to zero.
            u = min(time - self.stop, self.stop_time)
            local = self.stop - self.start + u - u * u / (2 * self.stop_time)
            rate = 1 - u / self.stop_time
        return self.trajectory.value(local), rate * self.trajectory.velocity(local)


@dataclass(frozen=True)
class TaskState:
    """Everything that the task knows.

    Attributes:
        phase: phase of the task.
        since: time at which the phase began, s.
        motion: motion that the arm executes.
        vacuum_on: whether the vacuum is to be on.
        looks: number of looks that have been asked for.
        view: index of the viewpoint that comes next.
        views_of_scene: number of looks since the scene was last touched.
        empty_looks: number of looks in a row that showed nothing to pick.
        failures: number of failures in a row, of any kind.
        known: what is known of the scene since it was last touched.
        obstacles: what was known of it before, without what was picked since.
        plan: the pick being executed, from `Phase.REACH` to `Phase.RELEASE`; None in
            all other phases.
        fills: estimated fill height below each drop of the tote, m.
        tries: executed picks by object id.
        failed_points: suction points that did not seal, p_O (3,), by object id.
        placed: objects that were let go over the tote, by object id.
        given_up: objects that are not tried any more, by object id.
        log: what happened.
    """

    phase: Phase
    since: float
    motion: Motion
    vacuum_on: bool = False
    looks: int = 0
    view: int = 0
    views_of_scene: int = 0
    empty_looks: int = 0
    failures: int = 0
    known: SceneEstimate | None = None
    obstacles: SceneEstimate = NOTHING_KNOWN
    plan: PickAndPlace | None = None
    fills: Fills = ()
    tries: Mapping[int, int] = field(default_factory=dict)
    failed_points: Mapping[int, tuple[Array, ...]] = field(default_factory=dict)
    placed: frozenset[int] = frozenset()
    given_up: frozenset[int] = frozenset()
    log: tuple[TaskEvent, ...] = ()

    def __deepcopy__(self, memo: object) -> TaskState:
        """Itself: nothing in it is ever changed."""
        return self

    @classmethod
    def at_rest(cls, rest: ArmTrajectory, fills: Fills) -> TaskState:
        """At time 0, before the first look.

        Args:
            rest: a motion that stays where the arm is.
            fills: fill height below each drop of the tote, m.
        """
        return cls(Phase.RETREAT, 0.0, Motion(rest, -rest.duration), fills=fills)

    @property
    def q(self) -> Array:
        """Where the arm stands when the motion is over, (n,)."""
        return self.motion.reference(self.motion.end)[0]

    def noted(
        self, time: float, kind: EventKind, text: str, name: str = ""
    ) -> TaskState:
        """With one more entry in the log."""
        return replace(self, log=(*self.log, TaskEvent(time, kind, text, name)))

    def enter(
        self,
        time: float,
        phase: Phase,
        trajectory: ArmTrajectory | None = None,
        delay: float = 0.0,
    ) -> TaskState:
        """In a new phase; a new motion, if one is given, begins after a delay (s)."""
        motion = self.motion if trajectory is None else Motion(trajectory, time + delay)
        return replace(self, phase=phase, since=time, motion=motion)

    def counted(self) -> TaskState:
        """With one more failure in a row."""
        return replace(self, failures=self.failures + 1)

    def touched(self) -> TaskState:
        """With the scene changed, so that what was seen of it does not hold."""
        return replace(self, plan=None, known=None, views_of_scene=0, empty_looks=0)


@dataclass(frozen=True)
class TaskInputs:
    """What the task learns at a step.

    Attributes:
        time: simulated time, s.
        vacuum: level of the vacuum sensor, 0..1.
        look: number of the newest look that was estimated, 0 before the first.
        estimate: estimate of that look; None if there is no estimate.
        error: why there is no estimate; empty if there is one.
    """

    time: float
    vacuum: float
    look: int = 0
    estimate: SceneEstimate | None = None
    error: str = ""
