# SPDX-License-Identifier: MIT
"""Clearing a table: look, decide, pick, place, look again, and recover from failures.

The task is a state machine on plain values. It takes the time, what the vacuum sensor
reads and what was estimated, and says where the arm is to go, whether the vacuum is on
and how many looks are wanted. It never learns where objects truly are.

    LOOK - SETTLE - ESTIMATE - REACH - APPROACH - SEAL - LIFT - CARRY - LOWER - RELEASE
     ^                 |                           |      |      |                |
     +-- next view ----+                        no seal  lost   lost              |
     +------------------- RETREAT <----------------+------+------+                |
     +----------------------------------------------------------------------------+
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from physim_drake.objects.model import ObjectLibrary
from physim_drake.picking.arm_planner import PickPlan
from physim_drake.picking.pick_choice import Choice, MotionPlanner, PickAndPlace, choose
from physim_drake.picking.planner_config import PlanFailure
from physim_drake.picking.policy import (
    PickCandidate,
    PickConditions,
    PickOrder,
    PickPolicy,
)
from physim_drake.picking.scenario import TaskConfig
from physim_drake.picking.scene_memory import (
    described,
    merged,
    on_table,
    without_object,
)
from physim_drake.picking.task_state import (
    EventKind,
    Phase,
    TaskInputs,
    TaskState,
)
from physim_drake.picking.tote import Tote
from physim_drake.picking.trajectories import ArmTrajectory
from physim_drake.poses import Array
from physim_drake.scene_estimate import SceneEstimate

_NO_VACUUM = 0.1  # below it, the object is free
_MAX_RELEASE = 5.0  # s


@dataclass(frozen=True)
class PickTask:
    """The state machine of an episode. All that changes is in `TaskState`.

    Attributes:
        config: thresholds, times and numbers of tries.
        planner: planner of the arm's motions.
        policy: choice of the next object and its suction point.
        last_resort: policy that is asked if no view of a scene gave a candidate, for
            instance one that takes objects of less confidence; may be None.
        library: the objects.
        conditions: conditions that every candidate has in common.
        views: poses of the camera X_WC (4, 4), in the order they are used.
        tote: tote that objects go into.
    """

    config: TaskConfig
    planner: MotionPlanner
    policy: PickPolicy
    last_resort: PickPolicy | None
    library: ObjectLibrary
    conditions: PickConditions
    views: Sequence[Array]
    tote: Tote

    def begin(self, rest: ArmTrajectory) -> TaskState:
        """The state at time 0.

        Args:
            rest: a motion that stays where the arm is.
        """
        return TaskState.at_rest(rest, self.tote.empty)

    def step(self, state: TaskState, inputs: TaskInputs) -> TaskState:
        """What the task wants from now on; the same object if nothing changes."""
        if state.phase is Phase.DONE:
            return state
        if state.plan is not None:
            return self._step_of_pick(state, inputs, state.plan)
        steps: Mapping[Phase, Callable[[TaskState, TaskInputs], TaskState]] = {
            Phase.LOOK: self._look_again_when_there,
            Phase.SETTLE: self._trigger_when_still,
            Phase.ESTIMATE: self._decide_when_estimated,
            Phase.RETREAT: self._look_when_clear,
        }
        return steps[state.phase](state, inputs)

    def _step_of_pick(
        self, state: TaskState, inputs: TaskInputs, plan: PickAndPlace
    ) -> TaskState:
        steps: Mapping[
            Phase, Callable[[TaskState, TaskInputs, PickAndPlace], TaskState]
        ] = {
            Phase.REACH: self._approach_when_there,
            Phase.APPROACH: self._seal_when_there,
            Phase.SEAL: self._lift_when_sealed,
            Phase.LIFT: self._carry_when_lifted,
            Phase.CARRY: self._lower_when_there,
            Phase.LOWER: self._release_when_there,
            Phase.RELEASE: self._look_when_released,
        }
        return steps[state.phase](state, inputs, plan)

    # One method a phase: what ends it, and what comes next.

    def _look_again_when_there(self, state: TaskState, inputs: TaskInputs) -> TaskState:
        if inputs.time < state.motion.end:
            return state
        return state.enter(inputs.time, Phase.SETTLE)

    def _trigger_when_still(self, state: TaskState, inputs: TaskInputs) -> TaskState:
        if inputs.time < state.since + self.config.settle_time:
            return state
        number = state.looks + 1
        taken = replace(state, looks=number, views_of_scene=state.views_of_scene + 1)
        view = (state.view - 1) % len(self.views) + 1
        text = f"look {number}, from viewpoint {view}"
        noted = taken.noted(inputs.time, EventKind.LOOK, text)
        return noted.enter(inputs.time, Phase.ESTIMATE)

    def _decide_when_estimated(self, state: TaskState, inputs: TaskInputs) -> TaskState:
        time, limit = inputs.time, self.config.estimate_timeout
        if inputs.look < state.looks:
            if time < state.since + limit:
                return state
            return self._without_estimate(state, time, f"none within {limit:g} s")
        if inputs.estimate is None:
            return self._without_estimate(state, time, inputs.error)
        return self._decide(state, time, inputs.estimate)

    def _approach_when_there(
        self, state: TaskState, inputs: TaskInputs, plan: PickAndPlace
    ) -> TaskState:
        if inputs.time < state.motion.end:
            return state
        on = replace(state, vacuum_on=True)
        return on.enter(inputs.time, Phase.APPROACH, plan.pick.approach)

    def _seal_when_there(
        self, state: TaskState, inputs: TaskInputs, plan: PickAndPlace
    ) -> TaskState:
        if inputs.time < state.motion.end:
            return state
        return state.enter(inputs.time, Phase.SEAL)

    def _lift_when_sealed(
        self, state: TaskState, inputs: TaskInputs, plan: PickAndPlace
    ) -> TaskState:
        if inputs.vacuum >= self.config.seal_level:
            return state.enter(inputs.time, Phase.LIFT, plan.pick.retreat)
        if inputs.time < state.since + self.config.seal_timeout:
            return state
        return self._not_sealed(state, inputs, plan.pick)

    def _carry_when_lifted(
        self, state: TaskState, inputs: TaskInputs, plan: PickAndPlace
    ) -> TaskState:
        if inputs.vacuum < self.config.lost_level:
            return self._dropped(state, inputs, plan.pick, "while it was lifted")
        if inputs.time < state.motion.end:
            return state
        return state.enter(inputs.time, Phase.CARRY, plan.carry)

    def _lower_when_there(
        self, state: TaskState, inputs: TaskInputs, plan: PickAndPlace
    ) -> TaskState:
        if inputs.vacuum < self.config.lost_level:
            return self._dropped(state, inputs, plan.pick, "on the way to the tote")
        if inputs.time < state.motion.end:
            return state
        return state.enter(inputs.time, Phase.LOWER, plan.lower)

    def _release_when_there(
        self, state: TaskState, inputs: TaskInputs, plan: PickAndPlace
    ) -> TaskState:
        if inputs.time < state.motion.end:
            return state
        off = replace(state, vacuum_on=False)
        return off.enter(inputs.time, Phase.RELEASE)

    def _look_when_released(
        self, state: TaskState, inputs: TaskInputs, plan: PickAndPlace
    ) -> TaskState:
        time, waited = inputs.time, inputs.time - state.since
        if inputs.vacuum >= _NO_VACUUM and waited > _MAX_RELEASE:
            return self._end(state, time, "the vacuum does not go away")
        if inputs.vacuum >= _NO_VACUUM or waited < self.config.release_time:
            return state
        candidate, held = plan.pick.candidate, plan.pick.held
        placed = replace(
            state,
            failures=0,
            view=0,
            placed=state.placed | {candidate.object_id},
            fills=self.tote.filled(state.fills, plan.drop, held, self.library),
        )
        text = f"{candidate.name} is let go over the tote"
        noted = placed.noted(time, EventKind.PLACED, text, candidate.name)
        return self._look(noted.touched(), time)

    def _look_when_clear(self, state: TaskState, inputs: TaskInputs) -> TaskState:
        if inputs.time < state.motion.end:
            return state
        return self._look(state, inputs.time)

    # What can happen.

    def _look(self, state: TaskState, time: float) -> TaskState:
        """On the way to the next viewpoint that can be reached."""
        self.planner.set_scene(state.obstacles)
        reason = ""
        for n in range(len(self.views)):
            view = (state.view + n) % len(self.views)
            try:
                way = self.planner.plan_look(state.q, self.views[view])
            except PlanFailure as failure:
                reason = str(failure)
                text = f"viewpoint {view + 1} cannot be taken: {reason}"
                state = state.noted(time, EventKind.NO_PLAN, text)
                continue
            state = replace(state, view=(view + 1) % len(self.views))
            return state.enter(time, Phase.LOOK, way, self.config.planning_time)
        return self._end(state, time, f"no viewpoint can be taken: {reason}")

    def _without_estimate(
        self, state: TaskState, time: float, reason: str
    ) -> TaskState:
        noted = state.noted(time, EventKind.NO_ESTIMATE, f"no estimate: {reason}")
        return self._failed(noted, time) or self._look(noted.counted(), time)

    def _decide(
        self, state: TaskState, time: float, estimate: SceneEstimate
    ) -> TaskState:
        """What to do about what was seen."""
        config = self.config
        seen = on_table(estimate, self.library, self.tote.holds, state.placed)
        known = merged(state.known, seen)
        state = replace(state, known=known, obstacles=known)
        state = state.noted(time, EventKind.ESTIMATE, described(seen))
        if not known.objects:
            state = replace(state, empty_looks=state.empty_looks + 1)
            if state.empty_looks >= config.empty_looks:
                return self._end(state, time, "nothing is left on the table")
            return self._look(state, time)
        state = replace(state, empty_looks=0)
        if {o.object_id for o in known.objects} <= state.given_up:
            return self._end(state, time, "what is left has been given up")
        choice = self._choose(state, known, self.policy)
        enough = state.views_of_scene >= config.max_views
        if choice.plan is None and enough and self.last_resort is not None:
            choice = self._choose(state, known, self.last_resort)
        if choice.plan is not None:
            return self._pick(state, time, choice.plan, known)
        for name, reason in choice.reasons.items():
            state = state.noted(time, EventKind.NO_PLAN, f"{name}: {reason}", name)
        if not enough:
            return self._look(state, time)
        for name, reason in choice.reasons.items():
            text = f"{name} is given up after {state.views_of_scene} views: {reason}"
            state = state.noted(time, EventKind.GIVEN_UP, text, name)
        return self._end(state, time, "nothing that is left can be picked")

    def _choose(
        self, state: TaskState, known: SceneEstimate, policy: PickPolicy
    ) -> Choice:
        skip = frozenset(
            n for n, o in enumerate(known.objects) if o.object_id in state.given_up
        )
        conditions = replace(self.conditions, skip=self.conditions.skip | skip)
        order = PickOrder.of(policy.order(known, self.library, conditions))
        self.planner.set_scene(known)
        choice = choose(
            self.planner,
            order,
            self.library,
            self.tote,
            state.q,
            state.fills,
            state.failed_points,
            self.config.max_plans,
        )
        missing = {
            o.name: "the cup finds no place on it that it can reach"
            for n, o in enumerate(known.objects)
            if n not in skip and o.name not in choice.reasons
        }
        return replace(choice, reasons={**choice.reasons, **missing})

    def _pick(
        self, state: TaskState, time: float, plan: PickAndPlace, known: SceneEstimate
    ) -> TaskState:
        candidate = plan.pick.candidate
        tries = state.tries.get(candidate.object_id, 0) + 1
        state = replace(
            state,
            plan=plan,
            tries={**state.tries, candidate.object_id: tries},
            obstacles=without_object(known, candidate.index),
        )
        noted = state.noted(time, EventKind.PICK, str(candidate), candidate.name)
        way = plan.pick.transfer
        return noted.enter(time, Phase.REACH, way, self.config.planning_time)

    def _not_sealed(
        self, state: TaskState, inputs: TaskInputs, pick: PickPlan
    ) -> TaskState:
        candidate, time = pick.candidate, inputs.time
        level, wanted = inputs.vacuum, self.config.seal_level
        text = (
            f"the cup does not seal on {candidate.name}: the vacuum reached "
            f"{level:.2f} of {wanted:.2f} in {self.config.seal_timeout:g} s"
        )
        points = (*state.failed_points.get(candidate.object_id, ()), candidate.p_O)
        state = replace(
            state,
            vacuum_on=False,
            failed_points={**state.failed_points, candidate.object_id: points},
        ).noted(time, EventKind.NO_SEAL, text, candidate.name)
        off = self._after_failed_pick(state, time, candidate)
        return self._failed(off, time) or off.enter(time, Phase.RETREAT, pick.retreat)

    def _dropped(
        self, state: TaskState, inputs: TaskInputs, pick: PickPlan, where: str
    ) -> TaskState:
        name, time = pick.candidate.name, inputs.time
        text = f"{name} was lost {where}: the vacuum fell to {inputs.vacuum:.2f}"
        state = replace(state, vacuum_on=False, motion=state.motion.stopped(time))
        state = state.noted(time, EventKind.DROPPED, text, name)
        off = self._after_failed_pick(state, time, pick.candidate)
        return self._failed(off, time) or off.enter(time, Phase.RETREAT)

    def _after_failed_pick(
        self, state: TaskState, time: float, candidate: PickCandidate
    ) -> TaskState:
        """Counts the failure, and gives the object up after the last try."""
        state = state.counted().touched()
        if state.tries[candidate.object_id] < self.config.tries:
            return state
        text = f"{candidate.name} is given up after {self.config.tries} picks"
        noted = state.noted(time, EventKind.GIVEN_UP, text, candidate.name)
        return replace(noted, given_up=state.given_up | {candidate.object_id})

    def _failed(self, state: TaskState, time: float) -> TaskState | None:
        """The end, if there have been too many failures in a row."""
        if state.failures < self.config.max_failures:
            return None
        return self._end(state, time, f"{state.failures} failures in a row")

    def _end(self, state: TaskState, time: float, reason: str) -> TaskState:
        off = replace(state, vacuum_on=False, plan=None)
        return off.noted(time, EventKind.END, reason).enter(time, Phase.DONE)
