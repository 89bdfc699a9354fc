# SPDX-License-Identifier: MIT
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from physim_drake.picking.task_state import EventKind, Phase, TaskState
from physim_drake.systems.pick_task import JointLayout, PickTaskSystem
from physim_drake.systems.stamped import Stamped
from tests.picking.fakes import CONFIG, ON_TABLE, FakePlanner, make_task, motion
from tests.picking.scenes import estimate_of
from tests.synthetic import SOAP

LAYOUT = JointLayout(np.array([0.5, 0.0, 0.7]), [1])


def task_system(planner: FakePlanner | None = None) -> PickTaskSystem:
    return PickTaskSystem(make_task(planner), LAYOUT, motion(np.zeros(1), np.zeros(1)))


class OneObject(LeafSystem):
    """Estimates at once that soap lies on the table, for one look, and then nothing."""

    def __init__(self) -> None:
        super().__init__()
        self._looks: Any = self.DeclareVectorInputPort("trigger", 1)
        self.DeclareAbstractOutputPort(
            "scene_estimate", lambda: Value(Stamped()), self._calc
        )

    def _calc(self, context: Any, output: Any) -> None:
        number = int(self._looks.Eval(context)[0])
        objects = [(SOAP, ON_TABLE[SOAP])] if number == 1 else []
        seen = estimate_of(objects) if number else None
        output.set_value(Stamped(seen, context.get_time(), number))


class Pump(LeafSystem):
    """Seals at once."""

    def __init__(self) -> None:
        super().__init__()
        on: Any = self.DeclareVectorInputPort("vacuum_on", 1)
        self.DeclareVectorOutputPort(
            "vacuum", 1, lambda context, y: y.SetFromVector(0.9 * on.Eval(context))
        )


def closed_loop() -> tuple[Any, PickTaskSystem]:
    builder = DiagramBuilder()
    task: Any = builder.AddSystem(task_system())
    for system in (OneObject(), Pump()):
        added: Any = builder.AddSystem(system)
        port, answer = added.get_input_port(0), added.get_output_port(0)
        builder.Connect(task.GetOutputPort(port.get_name()), port)
        builder.Connect(answer, task.GetInputPort(answer.get_name()))
    for name in ("desired_state", "task_state"):
        builder.ExportOutput(task.GetOutputPort(name), name)
    return builder.Build(), task


def run(diagram: Any, until: float, context: Any = None) -> Any:
    simulator = Simulator(diagram, context)
    simulator.AdvanceTo(until)
    return simulator.get_mutable_context()


def test_ports() -> None:
    system: Any = task_system()
    inputs = [system.get_input_port(n) for n in range(system.num_input_ports())]
    outputs = [system.get_output_port(n) for n in range(system.num_output_ports())]
    assert [port.get_name() for port in inputs] == ["scene_estimate", "vacuum"]
    assert [port.get_name() for port in outputs] == [
        "desired_state",
        "vacuum_on",
        "trigger",
        "task_state",
    ]
    assert system.GetOutputPort("desired_state").size() == 6


def test_it_is_stepped_with_its_period() -> None:
    diagram, _ = closed_loop()
    state: TaskState = diagram.GetOutputPort("task_state").Eval(run(diagram, 9.0))
    steps = np.array([event.time for event in state.log]) / CONFIG.period
    assert len(steps) > 3
    assert steps == pytest.approx(np.round(steps), abs=1e-6)
    way = motion(np.zeros(1), np.zeros(1)).duration + CONFIG.planning_time
    looked = next(e.time for e in state.log if e.kind is EventKind.LOOK)
    # On the way, then still, and a step for each of the two to be noticed.
    assert looked == pytest.approx(way + CONFIG.settle_time, abs=2.1 * CONFIG.period)


def test_joints_that_are_not_planned_rest() -> None:
    diagram, _ = closed_loop()
    context = run(diagram, 0.6)
    reference = diagram.GetOutputPort("desired_state").Eval(context)
    assert reference[[0, 2]] == pytest.approx([0.5, 0.7])
    assert reference[[3, 5]] == pytest.approx([0.0, 0.0])
    assert 0.0 < reference[1] < 1.0
    assert reference[4] > 0.0


def test_the_loop_clears_the_table() -> None:
    diagram, _ = closed_loop()
    state: TaskState = diagram.GetOutputPort("task_state").Eval(run(diagram, 20.0))
    assert state.phase is Phase.DONE
    kinds = [event.kind for event in state.log]
    assert kinds.count(EventKind.PLACED) == 1
    assert state.log[-1].text == "nothing is left on the table"


def test_the_same_start_gives_the_same_end() -> None:
    logs = []
    for _ in range(2):
        diagram, _ = closed_loop()
        logs.append(diagram.GetOutputPort("task_state").Eval(run(diagram, 8.0)).log)
    assert logs[0] == logs[1]


def test_a_cloned_context_goes_on_as_the_original() -> None:
    diagram, _ = closed_loop()
    context = run(diagram, 3.0)
    clone = context.Clone()
    port = diagram.GetOutputPort("desired_state")
    expected = np.array(port.Eval(run(diagram, 5.0, context)))
    log = diagram.GetOutputPort("task_state").Eval(context).log
    other = run(diagram, 5.0, clone)
    assert np.array_equal(port.Eval(other), expected)
    assert diagram.GetOutputPort("task_state").Eval(other).log == log
    assert other.get_time() == context.get_time()


def test_two_contexts_do_not_meet() -> None:
    diagram, _ = closed_loop()
    early, late = run(diagram, 0.5), run(diagram, 6.0)
    task_state = diagram.GetOutputPort("task_state")
    assert task_state.Eval(early).looks == 0
    assert task_state.Eval(late).looks > 0


def test_a_wrong_type_at_the_port_is_named() -> None:
    system: Any = task_system()
    context = system.CreateDefaultContext()
    system.GetInputPort("vacuum").FixValue(context, [0.0])
    system.GetInputPort("scene_estimate").FixValue(context, Value(Stamped(3, 0.0, 1)))
    with pytest.raises(TypeError, match=r"expects Stamped\[SceneEstimate\]"):
        Simulator(system, context).AdvanceTo(0.05)
