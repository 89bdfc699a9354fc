# SPDX-License-Identifier: MIT
"""Cheap systems that stand in for perception's, and a clock to simulate them by."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import (
    Context,
    Diagram,
    DiagramBuilder,
    EventStatus,
    LeafSystem,
)

from physim_drake.errors import InputError
from physim_drake.systems.source import Source
from physim_drake.systems.stage import EACH_STEP, Look, Stage, TimingConfig

STEP = 0.1


class Clock(LeafSystem):
    """Makes the simulator take steps of `STEP` s."""

    def __init__(self) -> None:
        super().__init__()
        self.DeclarePeriodicPublishEvent(STEP, 0.0, lambda _: EventStatus.DidNothing())


class Numbers(Source):
    """Each look is its number; looks named in `broken` fail."""

    def __init__(
        self,
        period: float | None = None,
        timing: TimingConfig = EACH_STEP,
        broken: tuple[int, ...] = (),
    ) -> None:
        super().__init__({"number": int}, period, timing)
        self._broken = broken
        self.calls: list[int] = []

    def capture(self, context: Context, number: int) -> tuple[Any, ...]:
        self.calls.append(number)
        if number in self._broken:
            raise InputError("lens", "is covered", "uncover it")
        return (number,)


class Function(Stage):
    """Applies a function to what its ports, called a, b, ..., show."""

    def __init__(
        self,
        function: Callable[..., Any],
        inputs: int = 1,
        timing: TimingConfig = EACH_STEP,
        **options: Any,
    ) -> None:
        names = "abc"[:inputs]
        super().__init__(dict.fromkeys(names, int), {"out": int}, timing, **options)
        self._function = function
        self.looks: list[Look] = []

    def work(self, look: Look) -> tuple[Any, ...]:
        self.looks.append(look)
        return (self._function(*(s.value for s in look.inputs.values())),)


def build(*systems: Any, connect: tuple[tuple[Any, Any], ...] = ()) -> Diagram:
    """A diagram of named systems, a clock, and connections (output, input port)."""
    builder = DiagramBuilder()
    for k, system in enumerate(systems):
        builder.AddNamedSystem(f"{type(system).__name__.lower()}_{k}", system)
    builder.AddNamedSystem("clock", Clock())
    for output, target in connect:
        builder.Connect(output, target)
    return builder.Build()


def shown(system: Any, context: Any, port: str = "out") -> Any:
    """What an output port shows, by the diagram's context."""
    return system.GetOutputPort(port).Eval(system.GetMyContextFromRoot(context))


def timeline(
    diagram: Diagram, system: Any, end: float, port: str = "out", start: Any = None
) -> list[tuple[float, Any]]:
    """(time, number) whenever the number at a port is seen to change.

    It is what a system sees at the beginning of the step at that time.
    """
    seen: list[tuple[float, Any]] = []

    def watch(context: Any) -> EventStatus:
        number = shown(system, context, port).number
        if not seen or seen[-1][1] != number:
            seen.append((round(context.get_time(), 6), number))
        return EventStatus.DidNothing()

    simulator = Simulator(diagram, start)
    simulator.set_monitor(watch)
    simulator.AdvanceTo(end)
    return seen
