# SPDX-License-Identifier: MIT
from __future__ import annotations

from typing import Any

import pytest
from pydrake.systems.analysis import Simulator

from physim_drake.errors import InputError
from physim_drake.systems.stage import TimingConfig
from tests.systems.looks import Numbers, build, shown, timeline


class Triggered:
    """A simulation of a source whose trigger is set by hand."""

    def __init__(self, source: Numbers, value: float = 0.0) -> None:
        self.source = source
        diagram = build(source)
        context = diagram.CreateDefaultContext()
        self._context: Any = source.GetMyMutableContextFromRoot(context)
        self._simulator = Simulator(diagram, context)
        self.trigger(value)

    def trigger(self, value: float) -> None:
        self.source.GetInputPort("trigger").FixValue(self._context, value)

    def advance_to(self, time: float) -> Any:
        self._simulator.AdvanceTo(time)
        return shown(self.source, self._simulator.get_context(), "number")


def test_a_look_is_begun_when_the_trigger_rises() -> None:
    source = Numbers()
    simulation = Triggered(source)
    assert simulation.advance_to(0.55).number == 0
    simulation.trigger(1.0)
    look = simulation.advance_to(1.05)
    assert (look.number, look.time) == (1, 0.55)
    assert simulation.advance_to(2.05) is look
    simulation.trigger(2.0)
    assert simulation.advance_to(3.0).number == 2
    assert source.calls == [1, 2]


def test_a_level_that_falls_and_rises_triggers_again() -> None:
    simulation = Triggered(Numbers())
    for n, value in enumerate((1.0, 0.0, 1.0, 1.0, 0.5, 0.7)):
        simulation.trigger(value)
        simulation.advance_to(n + 1.0)
    assert simulation.source.calls == [1, 2, 3]


def test_a_trigger_that_is_up_from_the_start_counts() -> None:
    simulation = Triggered(Numbers(), 1.0)
    assert simulation.advance_to(0.1).time == 0.0
    assert simulation.source.calls == [1]


def test_looks_are_begun_with_a_period() -> None:
    source = Numbers(period=0.4)
    diagram = build(source)
    assert timeline(diagram, source, 1.3, "number") == [
        (0.0, 0),
        (0.1, 1),
        (0.5, 2),
        (0.9, 3),
        (1.3, 4),
    ]


def test_a_period_and_a_trigger_go_together() -> None:
    simulation = Triggered(Numbers(period=1.0))
    simulation.advance_to(0.5)
    simulation.trigger(1.0)
    simulation.advance_to(1.5)
    assert simulation.source.calls == [1, 2, 3]


def test_trigger_and_period_of_the_same_moment_are_one_look_after_the_other() -> None:
    simulation = Triggered(Numbers(period=1.0), 1.0)
    assert simulation.advance_to(0.5).number == 2
    assert simulation.source.calls == [1, 2]


def test_without_a_period_the_trigger_must_be_connected() -> None:
    with pytest.raises(RuntimeError, match=r"trigger.*not connected"):
        Simulator(build(Numbers())).AdvanceTo(1.0)


def test_a_source_has_a_latency_too() -> None:
    source = Numbers(period=1.0, timing=TimingConfig(0.5))
    assert timeline(build(source), source, 1.6, "number") == [
        (0.0, 0),
        (0.6, 1),
        (1.6, 2),
    ]


def test_a_failed_look_has_a_number() -> None:
    simulation = Triggered(Numbers(broken=(1,)), 1.0)
    failed = simulation.advance_to(0.5)
    assert (failed.value, failed.number) == (None, 1)
    assert failed.error == "lens: is covered; uncover it"


def test_a_period_is_positive() -> None:
    with pytest.raises(InputError, match="period: is 0; give seconds above 0"):
        Numbers(period=0.0)
