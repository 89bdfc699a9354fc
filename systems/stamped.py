# SPDX-License-Identifier: MIT
"""What flows between the systems of perception: values with the look they are of."""

from __future__ import annotations

import typing
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

from physim_drake.storage.type_hints import without_alias

T = TypeVar("T")
_EARLY = 1e-9  # s; event times are sums of steps


class Immutable:
    """Copies of it are the object itself.

    Drake copies the abstract values of a context with every event that may change
    state, and Python's values deeply: images would be copied at each step. What is in
    a port is never changed, so that all contexts can share it.
    """

    def __copy__(self) -> typing.Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> typing.Self:
        return self


@dataclass(frozen=True)
class Stamped(Immutable, Generic[T]):
    """Something made of one look at the scene.

    Attributes:
        value: the thing; None if it is not made yet or could not be made.
        time: time at which the image was captured, s.
        number: number of the look: 1, 2, ...; 0 before the first.
        error: why it could not be made, for the user; empty if it could.
    """

    value: T | None = None
    time: float = 0.0
    number: int = 0
    error: str = ""


Results = tuple[Stamped[Any], ...]
"""One for each output port."""


@dataclass(frozen=True)
class LookState(Immutable):
    """The abstract state of a `LookSystem`.

    Attributes:
        shown: what the output ports show.
        coming: results that are made but not shown yet, and from when on, s.
        done: number of the last look that was worked on.
        waiting: for each input port, what it has shown that is not worked on yet.
        trigger: the value that a trigger port had last.
    """

    shown: Results
    coming: tuple[tuple[float, Results], ...] = ()
    done: int = 0
    waiting: tuple[Results, ...] = ()
    trigger: float = 0.0

    def with_results(
        self, number: int, results: Results, visible_from: float
    ) -> LookState:
        """After look `number` has been worked on."""
        coming = (*self.coming, (visible_from, results))
        return replace(self, done=number, coming=coming)

    def at(self, time: float) -> LookState:
        """With the next result shown, if it is due.

        One at a time: systems that watch the output match looks by number, and would
        miss one that is replaced within a step.
        """
        if not self.coming or time < self.coming[0][0] - _EARLY:
            return self
        return replace(self, shown=self.coming[0][1], coming=self.coming[1:])


def fits(value: object, kind: Any) -> bool:
    """Whether a value is of a type such as ``ndarray`` or ``tuple[Detection, ...]``."""
    kind = without_alias(kind)
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin is tuple:
        return isinstance(value, tuple) and all(fits(v, arguments[0]) for v in value)
    if origin is not None and issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(
            fits(v, arguments[1]) for v in value.values()
        )
    return isinstance(value, origin or kind)


def type_name(kind: Any) -> str:
    """What messages call a type."""
    kind = without_alias(kind)
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin is None:
        return str(getattr(kind, "__name__", kind))
    if origin is not tuple and not issubclass(origin, Mapping):
        return str(origin.__name__)
    inner = ", ".join("..." if a is ... else type_name(a) for a in arguments)
    return f"{origin.__name__}[{inner}]"
