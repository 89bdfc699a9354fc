# SPDX-License-Identifier: MIT
from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from physim_drake.errors import InputError
from physim_drake.systems.source import Source
from physim_drake.systems.stage import MOST_WAITING, Look, Stage, TimingConfig
from physim_drake.systems.stamped import Stamped
from tests.systems.looks import STEP, Clock, Function, Numbers, build, shown, timeline


def chain(*stages: Function, source: Numbers) -> Any:
    """A diagram of stages one behind the other."""
    ports = [source.GetOutputPort("number"), *(s.GetOutputPort("out") for s in stages)]
    targets = [stage.GetInputPort("a") for stage in stages]
    return build(source, *stages, connect=tuple(zip(ports[:-1], targets, strict=True)))


def test_each_look_is_worked_on_once() -> None:
    source, stage = Numbers(period=1.0), Function(lambda a: 10 * a)
    diagram = chain(stage, source=source)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(1.55)
    simulator.Initialize()
    simulator.AdvanceTo(2.55)
    assert source.calls == [1, 2, 3]
    assert [look.number for look in stage.looks] == [1, 2, 3]
    assert shown(stage, simulator.get_context()) == Stamped(30, 2.0, 3)
    assert shown(stage, simulator.get_context()) is shown(
        stage, simulator.get_context()
    )


def test_every_stage_of_a_chain_takes_a_step() -> None:
    stages = [Function(lambda a: a + 1) for _ in range(3)]
    diagram = chain(*stages, source=Numbers(period=10.0))
    assert timeline(diagram, stages[-1], 1.0) == [
        (0.0, 0),
        (pytest.approx(4 * STEP), 1),
    ]


def test_the_time_is_that_of_the_capture() -> None:
    stages = [Function(lambda a: a, timing=TimingConfig(0.3)) for _ in range(2)]
    diagram = chain(*stages, source=Numbers(period=1.0))
    simulator = Simulator(diagram)
    simulator.AdvanceTo(2.95)
    assert shown(stages[-1], simulator.get_context()) == Stamped(3, 2.0, 3)


@pytest.mark.parametrize("latency", [0.0, 0.25, 0.3, 1.5])
def test_results_are_shown_a_latency_after_work_began(latency: float) -> None:
    stage = Function(lambda a: a, timing=TimingConfig(latency))
    diagram = chain(stage, source=Numbers(period=1.0))
    first = STEP + math.ceil(latency / STEP - 1e-9) * STEP
    assert timeline(diagram, stage, 3.9)[:3] == [
        (0.0, 0),
        (pytest.approx(first + STEP), 1),
        (pytest.approx(first + STEP + 1.0), 2),
    ]
    assert len(stage.looks) == 4


def test_a_stage_can_look_at_its_inputs_on_its_own_clock() -> None:
    timing = TimingConfig(poll_period=0.25)
    stage = Function(lambda a: a, timing=timing)
    diagram = chain(stage, source=Numbers(period=1.0))
    assert timeline(diagram, stage, 2.5) == [(0.0, 0), (0.3, 1), (1.3, 2), (2.3, 3)]


def test_inputs_of_one_look_wait_for_each_other() -> None:
    source = Numbers(period=0.2)
    slow = Function(lambda a: 100 * a, timing=TimingConfig(1.0))
    both = Function(lambda a, b: a + b, inputs=2)
    diagram = build(
        source,
        slow,
        both,
        connect=(
            (source.GetOutputPort("number"), slow.GetInputPort("a")),
            (source.GetOutputPort("number"), both.GetInputPort("a")),
            (slow.GetOutputPort("out"), both.GetInputPort("b")),
        ),
    )
    simulator = Simulator(diagram)
    simulator.AdvanceTo(3.05)
    assert len(both.looks) > 5
    for k, look in enumerate(both.looks, start=1):
        assert (look.number, look["a"], look["b"]) == (k, k, 100 * k)
    assert shown(both, simulator.get_context()).value == 101 * len(both.looks)


def test_looks_that_an_input_leaves_out_are_left_out() -> None:
    source, both = Numbers(period=0.5), Function(lambda a, b: b, inputs=2)
    diagram = build(
        source,
        both,
        connect=((source.GetOutputPort("number"), both.GetInputPort("a")),),
    )
    context = diagram.CreateDefaultContext()
    port = both.GetInputPort("b")
    inner = both.GetMyMutableContextFromRoot(context)
    port.FixValue(inner, Stamped(0, 0.0, 0))
    simulator = Simulator(diagram, context)
    simulator.AdvanceTo(1.75)
    assert both.looks == []
    port.FixValue(inner, Stamped(30, 1.0, 3))
    simulator.AdvanceTo(2.75)
    assert [look.number for look in both.looks] == [3]
    port.FixValue(inner, Stamped(50, 2.0, 5))
    simulator.AdvanceTo(2.95)
    assert [look["a"] for look in both.looks] == [3, 5]


def test_a_port_that_falls_far_behind_is_named() -> None:
    source, both = Numbers(period=STEP), Function(lambda a, b: a, inputs=2)
    diagram = build(
        source,
        both,
        connect=((source.GetOutputPort("number"), both.GetInputPort("a")),),
    )
    context = diagram.CreateDefaultContext()
    both.GetInputPort("b").FixValue(
        both.GetMyMutableContextFromRoot(context), Stamped()
    )
    simulator = Simulator(diagram, context)
    simulator.AdvanceTo(STEP * MOST_WAITING)
    with pytest.raises(RuntimeError, match="function_1: input port b is 256 looks"):
        simulator.AdvanceTo(STEP * (MOST_WAITING + 3))


def test_an_optional_port_may_stay_unconnected() -> None:
    source = Numbers(period=1.0)
    stage = Function(lambda a, b: (a, b) == (1, None), inputs=2, optional=("b",))
    diagram = build(
        source,
        stage,
        connect=((source.GetOutputPort("number"), stage.GetInputPort("a")),),
    )
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.5)
    assert shown(stage, simulator.get_context()).value is True


def test_any_other_port_may_not() -> None:
    stage = Function(lambda a: a)
    with pytest.raises(RuntimeError, match=r"\(a\).*not connected"):
        Simulator(build(stage)).AdvanceTo(1.0)


def test_what_the_user_can_remedy_is_shown_and_passed_on() -> None:
    source = Numbers(period=1.0, broken=(2,))
    stages = [Function(lambda a: a) for _ in range(2)]
    judge = Function(lambda a: 0, takes_errors=True)
    simulator = Simulator(chain(*stages, judge, source=source))
    simulator.AdvanceTo(1.75)
    for stage in stages:
        failed = shown(stage, simulator.get_context())
        assert failed == Stamped(None, 1.0, 2, "lens: is covered; uncover it")
        assert [look.number for look in stage.looks] == [1]
    assert judge.looks[-1].error == "lens: is covered; uncover it"
    assert shown(judge, simulator.get_context()) == Stamped(0, 1.0, 2)
    simulator.AdvanceTo(2.75)
    assert shown(stages[-1], simulator.get_context()) == Stamped(3, 2.0, 3)


def refuse(a: int) -> int:
    raise InputError("scene", "has no surface")


def crash(a: int) -> int:
    raise ValueError("a defect")


def test_an_algorithm_may_refuse_a_look_but_not_crash() -> None:
    stage = Function(refuse)
    simulator = Simulator(chain(stage, source=Numbers(period=1.0)))
    simulator.AdvanceTo(0.5)
    assert shown(stage, simulator.get_context()).error == "scene: has no surface"
    with pytest.raises(ValueError, match="a defect"):
        Simulator(chain(Function(crash), source=Numbers(period=1.0))).AdvanceTo(0.5)


@pytest.mark.parametrize(
    ("value", "found"),
    [(3, "int: 3"), (Stamped("x", 0.0, 1), "str: 'x'")],
)
def test_a_wrong_input_is_named(value: Any, found: str) -> None:
    stage = Function(lambda a: a)
    diagram = build(stage)
    context = diagram.CreateDefaultContext()
    stage.GetInputPort("a").FixValue(stage.GetMyMutableContextFromRoot(context), value)
    text = rf"function_0: input port a expects Stamped\[int\], found {found}"
    with pytest.raises(TypeError, match=text):
        Simulator(diagram, context).AdvanceTo(1.0)


def test_a_wrong_result_is_named() -> None:
    stage = Function(lambda a: [a])
    with pytest.raises(TypeError, match=r"output port out expects int, found list"):
        Simulator(chain(stage, source=Numbers(period=1.0))).AdvanceTo(1.0)


def test_a_copy_of_the_context_goes_on_like_the_original() -> None:
    def totals(a: int) -> int:
        return 7 * a

    stages = [Function(totals, timing=TimingConfig(0.35)) for _ in range(2)]
    diagram = chain(*stages, source=Numbers(period=0.5))
    simulator = Simulator(diagram)
    simulator.AdvanceTo(1.3)  # with results on their way
    clone = simulator.get_context().Clone()
    original = timeline(diagram, stages[-1], 4.0, start=simulator.get_context().Clone())
    simulator.AdvanceTo(4.0)  # the copies are not of the same memory
    assert timeline(diagram, stages[-1], 4.0, start=clone) == original
    assert len(original) > 5
    assert shown(stages[-1], clone) == shown(stages[-1], simulator.get_context())


def test_a_look_knows_the_results_before_it() -> None:
    def number(a: int) -> int:
        return a

    stage = Function(number, timing=TimingConfig(0.75))
    diagram = chain(stage, source=Numbers(period=0.2))
    Simulator(diagram).AdvanceTo(1.5)
    assert [look.last[0].value for look in stage.looks[:4]] == [None, 1, 2, 3]


def test_outputs_are_not_evaluated_again_as_time_goes_on() -> None:
    evaluations = 0

    class Counted(Numbers):
        def _shower(self, k: int) -> Callable[[Any, Any], None]:
            show = super()._shower(k)

            def counted(context: Any, output: Any) -> None:
                nonlocal evaluations
                evaluations += 1
                show(context, output)

            return counted

    source, stage = Counted(period=10.0), Function(lambda a: a)
    diagram = chain(stage, source=source)
    Simulator(diagram).AdvanceTo(9.0)  # 90 steps that evaluate the port
    assert evaluations <= 3


def test_values_go_from_port_to_port_without_a_copy() -> None:
    big = np.zeros(10)

    class Camera(Source):
        def capture(self, context: Any, number: int) -> tuple[Any, ...]:
            return (big,)

    class Sink(Stage):
        def work(self, look: Look) -> tuple[Any, ...]:
            return (look["image"],)

    camera = Camera({"image": np.ndarray}, period=1.0)
    sink = Sink({"image": np.ndarray}, {"image": np.ndarray})
    wire = (camera.GetOutputPort("image"), sink.GetInputPort("image"))
    simulator = Simulator(build(camera, sink, connect=(wire,)))
    simulator.AdvanceTo(1.5)
    assert shown(sink, simulator.get_context().Clone(), "image").value is big


def test_time_does_not_run_backwards() -> None:
    for name in ("latency", "poll_period"):
        with pytest.raises(InputError, match=f"timing: {name}: is negative"):
            TimingConfig(**{name: -1.0})


def test_the_clock_of_these_tests_makes_steps() -> None:
    assert Clock().num_continuous_states() == 0
    stage = Function(lambda a: a)
    diagram = chain(stage, source=Numbers(period=10.0))
    simulator = Simulator(diagram)
    simulator.AdvanceTo(1.0)
    assert simulator.get_num_steps_taken() == 10
