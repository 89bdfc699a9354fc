# SPDX-License-Identifier: MIT
"""The base of the systems of perception: each works once on each look.

A look at the scene has a number, 1, 2, ... A `Source` begins looks; a `Stage` works on
a look when all its inputs show something of it. What they make is held in abstract
state, and every output port shows it `latency` seconds of simulated time later.

A system sees its inputs at the beginning of a step of the simulator, and all systems
see what was there before the step. So each stage of a chain takes one step more, even
without latency: with a plant of 1 ms, four stages take 4 ms. A simulation without
plant or controller has no steps of its own; give its stages a `poll_period`.

A cause that the user can remedy (`InputError`: no surface in the image, no points)
does not end the simulation: the result has no value but an `error`, which later stages
pass on.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

from pydrake.common.value import Value
from pydrake.systems.framework import Context

from physim_drake.systems.look_system import EACH_STEP, LookSystem, TimingConfig
from physim_drake.systems.stamped import LookState, Results, Stamped, fits, type_name

__all__ = ["EACH_STEP", "Look", "Stage", "Stamped", "TimingConfig"]

MOST_WAITING = 256
"""Looks that may wait at a port for the other ports to show them."""


@dataclass(frozen=True)
class Look:
    """What a stage works on.

    Attributes:
        number: number of the look, from 1.
        time: time at which it was captured, s.
        inputs: what each input port shows of it, `value` and `error`.
        last: the results of the look worked on before, one for each output port.
    """

    number: int
    time: float
    inputs: Mapping[str, Stamped[Any]]
    last: Results

    def __getitem__(self, port: str) -> Any:
        return self.inputs[port].value

    @property
    def error(self) -> str:
        """The first error among the inputs, if there is one."""
        return next((s.error for s in self.inputs.values() if s.error), "")


class Stage(LookSystem):
    """Works on a look when all its inputs show it; see the module.

    Looks are matched by number, so that an input with a latency does not meet another
    look on the port beside it. Looks that some input leaves out are not worked on.

    Args:
        inputs: name and type of each input port; a port expects `Stamped` of it.
        outputs: the same of the output ports.
        timing: latency and poll period.
        optional: input ports that need not be connected.
        takes_errors: whether it also works on looks that could not be made.
    """

    def __init__(
        self,
        inputs: Mapping[str, Any],
        outputs: Mapping[str, Any],
        timing: TimingConfig = EACH_STEP,
        *,
        optional: Collection[str] = (),
        takes_errors: bool = False,
    ) -> None:
        super().__init__(outputs, len(inputs), timing)
        self._takes_errors = takes_errors
        self._inlets = [
            _Inlet(
                name,
                kind,
                self.DeclareAbstractInputPort(name, Value(Stamped())),
                name in optional,
            )
            for name, kind in inputs.items()
        ]

    @abstractmethod
    def work(self, look: Look) -> tuple[Any, ...]:
        """Makes one value for each output port.

        Raises:
            InputError: if that is not possible; see the module.
        """

    def _watch(self, state: LookState, context: Context) -> LookState:
        state = self._receive(state, context)
        if not any(state.waiting):  # as in nearly all steps
            return state
        queues = {
            inlet.name: {s.number for s in queue}
            for inlet, queue in zip(self._inlets, state.waiting, strict=True)
            if inlet.is_used(context)
        }
        numbers = set.intersection(*queues.values())
        if numbers:
            return self._work_on(state, context, min(numbers))
        if max(map(len, queues.values())) > MOST_WAITING:
            behind = min(queues, key=lambda name: len(queues[name]))
            raise RuntimeError(
                f"{self.GetSystemPathname()}: input port {behind} is {MOST_WAITING} "
                "looks behind another; look less often, or see why it shows nothing"
            )
        return state

    def _receive(self, state: LookState, context: Context) -> LookState:
        """Takes down what is new at the ports."""
        for k, inlet in enumerate(self._inlets):
            if not inlet.is_used(context):
                continue
            shown: Any = inlet.port.Eval(context)
            if not isinstance(shown, Stamped):
                self._reject(*inlet.expectation, shown)
            queue = state.waiting[k]
            if shown.number <= (queue[-1].number if queue else state.done):
                continue
            if shown.value is not None and not fits(shown.value, inlet.kind):
                self._reject(*inlet.expectation, shown.value)
            waiting = list(state.waiting)
            waiting[k] = (*queue, shown)
            state = replace(state, waiting=tuple(waiting))
        return state

    def _work_on(self, state: LookState, context: Context, number: int) -> LookState:
        inputs: dict[str, Stamped[Any]] = {}
        for inlet, queue in zip(self._inlets, state.waiting, strict=True):
            shown = (s for s in queue if s.number == number)
            inputs[inlet.name] = next(shown, Stamped())
        time = max(s.time for s in inputs.values() if s.number)
        last = state.coming[-1][1] if state.coming else state.shown
        look = Look(number, time, inputs, last)
        left = (tuple(s for s in queue if s.number > number) for queue in state.waiting)
        return self._finish(
            replace(state, waiting=tuple(left)),
            context,
            number,
            time,
            lambda: self.work(look),
            "" if self._takes_errors else look.error,
        )


@dataclass(frozen=True)
class _Inlet:
    """An input port of a stage."""

    name: str
    kind: Any
    port: Any
    optional: bool

    def is_used(self, context: Context) -> bool:
        """Whether looks have to be seen here."""
        return not self.optional or bool(self.port.HasValue(context))

    @property
    def expectation(self) -> tuple[str, str]:
        """What messages say of it."""
        return f"input port {self.name}", f"Stamped[{type_name(self.kind)}]"
