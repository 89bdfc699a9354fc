# SPDX-License-Identifier: MIT
"""How far a command is: a bar on a terminal, elsewhere a line now and then."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
)

from physim_drake.closing import Closing

LINE_EVERY = 30.0
"""Time between lines if there is no terminal, s."""


class Steps(Closing):
    """Tells how many of some steps are done, how long one takes and what is left.

    Use it as a context manager.

    Attributes:
        begun: whether `begin` was called.

    Args:
        console: output; a quiet one shows nothing.
        unit: name of a step, as in "image".
        total: number of steps.
        clock: function that gives the time, s.
    """

    def __init__(
        self,
        console: Console,
        unit: str,
        total: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._console, self._unit, self._total = console, unit, total
        self._clock, self._start = clock, clock()
        self._told, self._done, self._first = self._start, 0, 0
        self.begun = False
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            console=console,
            disable=not console.is_terminal,
            transient=True,
        )
        self._task = self._bar.add_task(f"{unit}s", total=total)

    def begin(self, done: int, what: str = "") -> None:
        """Says that so many steps were done before: they do not count for the pace."""
        self.begun = True
        self._first = self._done = done
        shown = what or f"{self._unit}s"
        self._bar.update(self._task, completed=done, description=shown)

    def advance(self, what: str = "") -> None:
        """One more step is done; `what` names the next one."""
        self.reach(self._done + 1, what)

    def reach(self, done: int, what: str = "") -> None:
        """So many steps are done."""
        self._done = done
        texts = [text for text in (what, self.pace()) if text]
        shown = ", ".join(texts or [f"{self._unit}s"])
        self._bar.update(self._task, completed=done, description=shown)
        now = self._clock()
        if not self._console.is_terminal and now - self._told >= LINE_EVERY:
            self._told = now
            so_far = f"{done} of {self._total} {self._unit}s"
            self.say(", ".join([so_far, *texts]))

    def say(self, text: str) -> None:
        """Prints a line above the bar."""
        self._console.print(text, markup=False, soft_wrap=True)

    def pace(self) -> str:
        """Seconds a step, and how long the rest takes at this pace; "" at first."""
        new = self._done - self._first
        if not new:
            return ""
        each = (self._clock() - self._start) / new
        rate = f"{each:.1f} s" if each >= 0.1 else f"{1000 * each:.0f} ms"
        left = _clock_time(each * (self._total - self._done))
        return f"{rate} a{_n(self._unit)} {self._unit}, {left} left"

    def close(self) -> None:
        """Takes the bar away."""
        self._bar.stop()

    def __enter__(self) -> Self:
        self._bar.start()
        return self


def _clock_time(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02}:{rest:02}"


def _n(noun: str) -> str:
    return "n" if noun[0] in "aeiou" else ""
