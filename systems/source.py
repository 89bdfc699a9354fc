# SPDX-License-Identifier: MIT
"""The base of the systems that begin looks: by a trigger, or with a period."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from pydrake.systems.framework import Context, EventStatus, State

from physim_drake.errors import InputError
from physim_drake.systems.look_system import EACH_STEP, LookSystem, TimingConfig
from physim_drake.systems.stamped import LookState


class Source(LookSystem):
    """Begins a look whenever its trigger rises, or a period is over.

    .. pydrake_system::

        name: Source
        input_ports:
        - trigger (optional with a period)

    ``trigger`` (BasicVector of 1) may be a count or a level: a look is begun at each
    step at which it is above its value of the step before, which is 0 at first. With a
    period looks are begun at 0, period, 2 period, ... as well.

    Args:
        outputs: name and type of each output port; a port holds `Stamped` of it.
        period: time between looks, s; None for looks by the trigger alone.
        timing: times at which triggers are seen and results are shown.
    """

    def __init__(
        self,
        outputs: Mapping[str, Any],
        period: float | None = None,
        timing: TimingConfig = EACH_STEP,
    ) -> None:
        if period is not None and not period > 0:
            raise InputError("period", f"is {period:g}", "give seconds above 0")
        super().__init__(outputs, 0, timing)
        self._trigger: Any = self.DeclareVectorInputPort("trigger", 1)
        self._periodic = period is not None
        if period is not None:
            self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._on_period)

    @abstractmethod
    def capture(self, context: Context, number: int) -> tuple[Any, ...]:
        """Makes one value for each output port, of what is there now.

        Args:
            context: whose input ports show it.
            number: number of the look, from 1.

        Raises:
            InputError: if that is not possible.
        """

    def has_look(self, number: int) -> bool:
        """Whether there is anything to capture for look `number`."""
        return True

    def _on_period(self, context: Context, state: State) -> EventStatus:
        return self._update(context, state, self._capture)

    def _watch(self, state: LookState, context: Context) -> LookState:
        if self._periodic and not self._trigger.HasValue(context):
            return state
        value = float(self._trigger.Eval(context)[0])
        if value == state.trigger:
            return state
        watched = replace(state, trigger=value)
        return self._capture(watched, context) if value > state.trigger else watched

    def _capture(self, state: LookState, context: Context) -> LookState:
        number = state.done + 1
        if not self.has_look(number):
            return state
        return self._finish(
            state,
            context,
            number,
            context.get_time(),
            lambda: self.capture(context, number),
        )
