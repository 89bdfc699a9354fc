# SPDX-License-Identifier: MIT
from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from physim_drake.picking.task import PickTask
from physim_drake.picking.task_state import EventKind, Phase, TaskInputs, TaskState
from physim_drake.poses import Array, make_pose
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from tests.picking.fakes import CONFIG, ON_TABLE, FakePlanner, make_task, motion
from tests.picking.scenes import estimate_of
from tests.synthetic import BALL, ERASER, SOAP, library


@dataclass
class World:
    """Answers the task: shows what lies on the table, and seals or not.

    Attributes:
        task: the task.
        table: objects on the table, by id.
        confidence: of every estimate, by the number of the look.
        seals: whether the cup seals, by the number of the pick.
        loses: the phase in which the object is lost, by the number of the pick.
    """

    task: PickTask
    table: dict[int, Array] = field(default_factory=lambda: dict(ON_TABLE))
    confidence: Callable[[int], float] = lambda look: 0.9
    error: Callable[[int], str] = lambda look: ""
    seals: Callable[[int], bool] = lambda pick: True
    loses: Callable[[int], Phase | None] = lambda pick: None
    shown: int = 0
    states: list[TaskState] = field(default_factory=list)

    def run(self, until: float = 200.0) -> TaskState:
        rest = motion(np.zeros(1), np.zeros(1))
        state = self.task.begin(rest)
        estimate: SceneEstimate | None = None
        for time in np.arange(0.0, until, 0.05):
            if state.looks > self.shown:  # an estimate takes one step
                self.shown = state.looks
                estimate = self.look()
            self.place(state)
            inputs = TaskInputs(
                time,
                self.vacuum(state),
                self.shown,
                estimate,
                self.error(self.shown),
            )
            state = self.task.step(state, inputs)
            self.states.append(state)
            if state.phase is Phase.DONE:
                break
        return state

    def look(self) -> SceneEstimate | None:
        if self.error(self.shown):
            return None
        objects = list(self.table.items())
        sure = (self.confidence(self.shown),) * len(objects)
        return estimate_of(objects, sure)

    def vacuum(self, state: TaskState) -> float:
        pick = count(state, EventKind.PICK)
        on = state.vacuum_on and self.seals(pick) and state.phase != Phase.APPROACH
        return 0.9 if on and state.phase != self.loses(pick) else 0.0

    def place(self, state: TaskState) -> None:
        if state.phase is Phase.RELEASE and state.plan is not None:
            self.table.pop(state.plan.pick.candidate.object_id, None)


def count(state: TaskState, kind: EventKind) -> int:
    return sum(event.kind is kind for event in state.log)


def texts(state: TaskState, kind: EventKind) -> list[str]:
    return [event.text for event in state.log if event.kind is kind]


def test_a_table_is_cleared_and_the_task_says_so() -> None:
    world = World(make_task())
    end = world.run()
    assert end.phase is Phase.DONE
    assert end.log[-1].text == "nothing is left on the table"
    assert count(end, EventKind.PICK) == count(end, EventKind.PLACED) == 2
    assert not world.table
    assert not end.vacuum_on


def test_phases_follow_each_other() -> None:
    world = World(make_task(), table={SOAP: ON_TABLE[SOAP]})
    world.run()
    phases = [world.states[0].phase]
    for state in world.states:
        if state.phase is not phases[-1]:
            phases.append(state.phase)
    first_pick = phases[phases.index(Phase.REACH) :]
    assert first_pick[:7] == [
        Phase.REACH,
        Phase.APPROACH,
        Phase.SEAL,
        Phase.LIFT,
        Phase.CARRY,
        Phase.LOWER,
        Phase.RELEASE,
    ]


def test_there_is_a_plan_in_the_phases_of_a_pick_and_in_no_other() -> None:
    picking = {
        Phase.REACH,
        Phase.APPROACH,
        Phase.SEAL,
        Phase.LIFT,
        Phase.CARRY,
        Phase.LOWER,
        Phase.RELEASE,
    }
    loses = {1: Phase.LIFT, 2: Phase.CARRY}
    world = World(make_task(), seals=lambda n: n != 3, loses=loses.get)
    world.run()
    for state in world.states:
        assert (state.plan is not None) == (state.phase in picking)
    assert {state.phase for state in world.states} >= {*picking, Phase.RETREAT}


def test_the_reference_never_jumps() -> None:
    world = World(make_task(), loses=lambda n: Phase.CARRY if n == 1 else None)
    world.run()
    times = 0.05 * np.arange(len(world.states))
    q = [s.motion.reference(t)[0][0] for s, t in zip(world.states, times, strict=True)]
    assert np.abs(np.diff(q)).max() < 3.2 * 0.05  # the fastest goes 3.15 rad/s


def test_the_arm_waits_while_it_plans() -> None:
    world = World(make_task())
    world.run()
    reach = next(s for s in world.states if s.phase is Phase.REACH)
    assert reach.motion.start == pytest.approx(reach.since + CONFIG.planning_time)


def test_a_cup_that_does_not_seal_is_tried_elsewhere_after_another_look() -> None:
    world = World(make_task(), seals=lambda pick: pick != 1)
    end = world.run()
    assert not world.table
    (text,) = texts(end, EventKind.NO_SEAL)
    assert "the vacuum reached 0.00 of 0.45" in text
    sealing = [s.plan for s in world.states if s.phase is Phase.SEAL]
    picked = [plan.pick for plan in sealing if plan]
    first, second = picked[0].candidate, picked[-1].candidate
    assert count(end, EventKind.PICK) == 3
    again = next(p.candidate for p in picked if p is not picked[0])
    assert again.name == first.name
    assert np.linalg.norm(again.p_O - first.p_O) > 0.01
    assert second.name != first.name


def test_a_lost_object_is_noticed_and_picked_again() -> None:
    for phase, where in ((Phase.LIFT, "lifted"), (Phase.CARRY, "way to the tote")):
        world = World(
            make_task(), loses=lambda n, phase=phase: phase if n == 1 else None
        )
        end = world.run()
        (text,) = texts(end, EventKind.DROPPED)
        assert where in text
        assert not world.table
        assert count(end, EventKind.PLACED) == 2


def test_an_object_is_given_up_after_its_tries_and_others_are_not() -> None:
    soap = library()[SOAP].name
    world = World(make_task())
    world.seals = lambda pick: (
        world.states[-1].plan is None
        or world.states[-1].plan.pick.candidate.object_id != SOAP
    )
    end = world.run()
    assert set(world.table) == {SOAP}
    (text,) = texts(end, EventKind.GIVEN_UP)
    assert text == f"{soap} is given up after 2 picks"
    assert end.log[-1].text == "what is left has been given up"


def test_too_many_failures_in_a_row_end_the_episode() -> None:
    config = replace(CONFIG, tries=99, max_failures=3)
    end = World(make_task(config=config), seals=lambda pick: False).run()
    assert end.log[-1].text == "3 failures in a row"
    assert count(end, EventKind.NO_SEAL) == 3


def test_uncertain_objects_are_looked_at_from_elsewhere_first() -> None:
    world = World(make_task(), confidence=lambda look: 0.3 if look == 1 else 0.9)
    end = world.run()
    kinds = [e.kind for e in end.log]
    assert kinds[: kinds.index(EventKind.PICK)].count(EventKind.LOOK) == 2
    assert "viewpoint 2" in texts(end, EventKind.LOOK)[1]


def test_what_stays_uncertain_is_picked_as_a_last_resort() -> None:
    world = World(make_task(), confidence=lambda look: 0.3)
    world.run()
    assert not world.table


def test_what_is_not_believed_at_all_is_given_up_with_the_reason() -> None:
    end = World(make_task(), confidence=lambda look: 0.05).run()
    assert count(end, EventKind.PICK) == 0
    assert "after 2 views" in texts(end, EventKind.GIVEN_UP)[0]
    assert end.log[-1].text == "nothing that is left can be picked"


def test_no_plan_for_one_object_does_not_keep_the_other_from_the_tote() -> None:
    world = World(make_task(FakePlanner(unreachable={SOAP})))
    end = world.run()
    assert set(world.table) == {SOAP}
    assert any("out of reach" in text for text in texts(end, EventKind.GIVEN_UP))


def test_a_viewpoint_out_of_reach_is_passed_over() -> None:
    world = World(make_task(FakePlanner(views=1)))
    end = world.run()
    assert not world.table
    assert any(
        "viewpoint 2 cannot be taken" in t for t in texts(end, EventKind.NO_PLAN)
    )


def test_no_viewpoint_within_reach_ends_the_episode() -> None:
    end = World(make_task(FakePlanner(views=0))).run()
    assert end.log[-1].text == "no viewpoint can be taken: look: too far"


def test_a_look_without_an_estimate_is_repeated() -> None:
    world = World(make_task(), error=lambda look: "no surface" if look == 1 else "")
    end = world.run()
    assert texts(end, EventKind.NO_ESTIMATE) == ["no estimate: no surface"]
    assert not world.table


def test_an_estimate_that_never_comes_is_noticed() -> None:
    world = World(make_task(config=replace(CONFIG, max_failures=2)))
    world.shown = 99
    state = world.task.begin(motion(np.zeros(1), np.zeros(1)))
    for time in np.arange(0.0, 100.0, 0.05):
        state = world.task.step(state, TaskInputs(time, 0.0))
    assert state.log[-1].text == "2 failures in a row"
    assert "none within 30 s" in texts(state, EventKind.NO_ESTIMATE)[0]


def test_objects_in_the_tote_are_no_objects_on_the_table() -> None:
    in_tote = make_pose(p=[5.1, 0.0, 0.05])
    world = World(make_task(), table={BALL: in_tote})
    end = world.run()
    assert count(end, EventKind.PICK) == 0
    assert end.log[-1].text == "nothing is left on the table"


def test_what_was_seen_before_stays_an_obstacle_until_something_is_touched() -> None:
    planner = FakePlanner()
    task = make_task(planner)
    state = task.begin(motion(np.zeros(1), np.zeros(1)))
    unsure = estimate_of([(SOAP, ON_TABLE[SOAP])], (0.2,))
    other = estimate_of([(ERASER, ON_TABLE[ERASER])], (0.9,))
    for time in np.arange(0.0, 20.0, 0.05):
        shown = {0: None, 1: unsure}.get(state.looks, other)
        state = task.step(state, TaskInputs(time, 0.0, state.looks, shown))
        if state.phase is Phase.REACH:
            break
    assert planner.scene is not None
    assert {o.object_id for o in planner.scene.objects} == {SOAP, ERASER}
    assert {o.object_id for o in state.obstacles.objects} == {SOAP}


def test_a_copied_state_goes_on_as_the_original() -> None:
    world = World(make_task())
    world.run()
    middle = world.states[len(world.states) // 2]
    inputs = TaskInputs(1e3, 0.9, middle.looks, estimate_of([]))
    one = world.task.step(middle, inputs)
    other = world.task.step(deepcopy(middle), inputs)
    assert one.phase is other.phase
    assert one.log == other.log


def test_an_object_that_is_not_found_is_named() -> None:
    missing = ObjectEstimate(SOAP, "soap", None, None, 0.0, "too few points")
    estimate = replace(estimate_of([]), objects=(missing,))
    task = make_task()
    state = task.begin(motion(np.zeros(1), np.zeros(1)))
    for time in np.arange(0.0, 60.0, 0.05):
        state = task.step(state, TaskInputs(time, 0.0, state.looks, estimate))
    assert "soap not found (too few points)" in texts(state, EventKind.ESTIMATE)
    assert count(state, EventKind.GIVEN_UP) == 1
