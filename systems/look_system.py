# SPDX-License-Identifier: MIT
"""The base of all systems that make something of looks; see `stage`."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

from pydrake.common.value import Value
from pydrake.systems.framework import Context, EventStatus, LeafSystem, State

from physim_drake.errors import InputError
from physim_drake.systems.stamped import LookState, Results, Stamped, fits, type_name


@dataclass(frozen=True)
class TimingConfig:
    """When a system looks at its inputs and shows its results.

    Attributes:
        latency: time from the beginning of the work until its results are shown, s;
            it stands for computing time, of which the simulation knows nothing.
        poll_period: time between looks at the inputs, s; 0 for each step of the
            simulator.
    """

    latency: float = 0.0
    poll_period: float = 0.0

    def __post_init__(self) -> None:
        for name in ("latency", "poll_period"):
            if not getattr(self, name) >= 0:
                raise InputError("timing", "is negative", "give seconds", name)


EACH_STEP = TimingConfig()
"""No latency, and inputs are looked at in each step."""


class LookSystem(LeafSystem):
    """Holds the results of looks in abstract state and shows them when they are due.

    Args:
        outputs: name and type of each output port; a port holds `Stamped` of it.
        inputs: number of ports that wait for looks.
        timing: latency and poll period.
    """

    def __init__(
        self, outputs: Mapping[str, Any], inputs: int, timing: TimingConfig
    ) -> None:
        super().__init__()
        self._outputs, self._latency = dict(outputs), timing.latency
        self._timer: Callable[[], AbstractContextManager[None]] = nullcontext
        nothing: Results = tuple(Stamped() for _ in outputs)
        start = LookState(nothing, waiting=((),) * inputs)
        self._state: Any = self.DeclareAbstractState(Value(start))
        for k, name in enumerate(outputs):
            self.DeclareAbstractOutputPort(
                name,
                lambda: Value(Stamped()),
                self._shower(k),
                # Else it would be evaluated again whenever time goes on.
                {self.abstract_state_ticket(self._state)},
            )
        if timing.poll_period:
            self.DeclarePeriodicUnrestrictedUpdateEvent(
                timing.poll_period, 0.0, self._on_step
            )
        else:
            self.DeclarePerStepUnrestrictedUpdateEvent(self._on_step)

    def time_work(self, timer: Callable[[], AbstractContextManager[None]]) -> None:
        """Enters a context around the work on each look, to measure its wall time.

        Args:
            timer: makes the context.
        """
        self._timer = timer

    def _shower(self, k: int) -> Callable[[Any, Any], None]:
        def show(context: Any, output: Any) -> None:
            state: LookState = context.get_abstract_state(self._state).get_value()
            output.set_value(state.shown[k])

        return show

    def _on_step(self, context: Context, state: State) -> EventStatus:
        return self._update(context, state, self._watch)

    def _update(
        self,
        context: Context,
        state: State,
        change: Callable[[LookState, Context], LookState],
    ) -> EventStatus:
        # From `state`, not `context`: another event of the same moment may have
        # changed it already.
        cell = state.get_mutable_abstract_state(self._state)
        old: LookState = cell.get_value()
        new = change(old, context).at(context.get_time())
        if new is old:
            return EventStatus.DidNothing()
        cell.set_value(new)
        return EventStatus.Succeeded()

    @abstractmethod
    def _watch(self, state: LookState, context: Context) -> LookState:
        """Looks at the inputs, and works if there is something to do."""

    def _finish(
        self,
        state: LookState,
        context: Context,
        number: int,
        time: float,
        make: Callable[[], tuple[Any, ...]],
        error: str = "",
    ) -> LookState:
        """Makes the results of a look, or takes down why there are none."""
        values: tuple[Any, ...] = (None,) * len(self._outputs)
        if not error:
            try:
                with self._timer():
                    values = make()
            except InputError as cause:
                error = str(cause)
        for (name, kind), value in zip(self._outputs.items(), values, strict=True):
            if value is not None and not fits(value, kind):
                self._reject(f"output port {name}", type_name(kind), value)
        results = tuple(Stamped(value, time, number, error) for value in values)
        return state.with_results(number, results, context.get_time() + self._latency)

    def _reject(self, port: str, expected: str, found: object) -> None:
        raise TypeError(
            f"{self.GetSystemPathname()}: {port} expects {expected}, found "
            f"{type(found).__name__}: {found!r:.80}"
        )
