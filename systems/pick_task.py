# SPDX-License-Identifier: MIT
"""The pick task as a system: ports in, joint reference, vacuum and looks out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import (
    BasicVector,
    Context,
    EventStatus,
    LeafSystem,
    State,
)

from physim_drake.picking.task import PickTask
from physim_drake.picking.task_state import TaskInputs, TaskState
from physim_drake.picking.trajectories import ArmTrajectory
from physim_drake.poses import Array
from physim_drake.scene_estimate import SceneEstimate
from physim_drake.systems.stamped import Stamped, fits


@dataclass(frozen=True)
class JointLayout:
    """The planned joints among the robot's actuated ones.

    Attributes:
        rest: angles of all actuated joints when the arm is at home, (m,), rad.
        planned: indices of the planned joints among them, (n,).
    """

    rest: Array
    planned: Sequence[int]

    def state(self, q: Array, v: Array) -> Array:
        """Angles and velocities of all actuated joints, (2 m,)."""
        angles, velocities = self.rest.copy(), np.zeros(len(self.rest))
        angles[self.planned], velocities[self.planned] = q, v
        return np.concatenate([angles, velocities])


class PickTaskSystem(LeafSystem):
    """Clears the table; see `PickTask`.

    .. pydrake_system::

        name: PickTaskSystem
        input_ports:
        - scene_estimate
        - vacuum
        output_ports:
        - desired_state
        - vacuum_on
        - trigger
        - task_state

    Inputs: ``scene_estimate`` (Stamped[SceneEstimate]), ``vacuum`` (BasicVector of 1,
    0..1). Outputs: ``desired_state`` (BasicVector: angles, rad, then velocities, rad/s,
    of the robot's actuated joints), ``vacuum_on`` (BasicVector of 1, 0 or 1),
    ``trigger`` (BasicVector of 1, how many looks are wanted so far), ``task_state``
    (TaskState). State: the same `TaskState`, stepped with the task's period.

    Planning happens within a step, and takes no simulated time but the task's
    `planning_time`.

    Args:
        task: the task.
        layout: layout of the robot's joints.
        rest: a motion that stays where the arm begins.
    """

    def __init__(
        self, task: PickTask, layout: JointLayout, rest: ArmTrajectory
    ) -> None:
        LeafSystem.__init__(self)
        self._task, self._layout = task, layout
        self._estimate: Any = self.DeclareAbstractInputPort(
            "scene_estimate", Value(Stamped())
        )
        self._vacuum: Any = self.DeclareVectorInputPort("vacuum", 1)
        self._state: Any = self.DeclareAbstractState(Value(task.begin(rest)))
        ticket = self.abstract_state_ticket(self._state)
        self.DeclareVectorOutputPort(
            "desired_state",
            2 * len(layout.rest),
            self._calc_desired_state,
            prerequisites_of_calc={ticket, self.time_ticket()},
        )
        for name, value in (("vacuum_on", _vacuum_on), ("trigger", _looks)):
            self.DeclareVectorOutputPort(
                name, 1, self._shower(value), prerequisites_of_calc={ticket}
            )
        self.DeclareAbstractOutputPort(
            "task_state",
            lambda: Value(task.begin(rest)),
            self._show_task_state,
            prerequisites_of_calc={ticket},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(task.config.period, 0.0, self._step)

    def _show_task_state(self, context: Any, output: Any) -> None:
        output.set_value(self.task_state(context))

    def task_state(self, context: Context) -> TaskState:
        """What the task knows in this system's own context."""
        state: TaskState = context.get_abstract_state(self._state).get_value()
        return state

    def _step(self, context: Context, state: State) -> EventStatus:
        old = self.task_state(context)
        new = self._task.step(old, self._inputs(context))
        if new is old:
            return EventStatus.DidNothing()
        state.get_mutable_abstract_state(self._state).set_value(new)
        return EventStatus.Succeeded()

    def _inputs(self, context: Context) -> TaskInputs:
        seen: Any = self._estimate.Eval(context)
        if not isinstance(seen, Stamped) or not (
            seen.value is None or fits(seen.value, SceneEstimate)
        ):
            raise TypeError(
                f"{self.GetSystemPathname()}: input port scene_estimate expects "
                f"Stamped[SceneEstimate], found {type(seen).__name__}"
            )
        vacuum = float(self._vacuum.Eval(context)[0])
        return TaskInputs(
            context.get_time(), vacuum, seen.number, seen.value, seen.error
        )

    def _calc_desired_state(self, context: Context, output: Any) -> None:
        motion = self.task_state(context).motion
        output.SetFromVector(self._layout.state(*motion.reference(context.get_time())))

    def _shower(self, value: Any) -> Any:
        def show(context: Context, output: BasicVector) -> None:
            output.SetAtIndex(0, value(self.task_state(context)))

        return show


def _vacuum_on(state: TaskState) -> float:
    return float(state.vacuum_on)


def _looks(state: TaskState) -> float:
    return float(state.looks)
