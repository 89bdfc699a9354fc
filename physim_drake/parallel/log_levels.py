# SPDX-License-Identifier: MIT
"""How much the loggers tell, here and in the processes that work for this one."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

T = TypeVar("T")

_NAMES = ("", "physim_drake", "drake")
_FORMAT = "%(levelname)s %(name)s: %(message)s"


@dataclass(frozen=True)
class LogLevels:
    """What the loggers of a process tell.

    Attributes:
        levels: level by the name of the logger; the root's name is empty.
        shown: whether messages are written to stderr.
    """

    levels: Mapping[str, int]
    shown: bool = True

    @classmethod
    def current(cls) -> LogLevels:
        """Those of this process."""
        levels = {name: logging.getLogger(name).level for name in _NAMES}
        return cls(levels, bool(logging.getLogger().handlers))

    def apply(self) -> None:
        """Has the loggers of this process tell as much."""
        if self.shown:
            logging.basicConfig(format=_FORMAT)
        for name, level in self.levels.items():
            logging.getLogger(name).setLevel(level)


def telling_as_here(make: Callable[[], T]) -> Callable[[], T]:
    """Makes the same in another process, whose loggers then tell what those here do.

    Args:
        make: function to call there. It must be picklable; what is returned also is.
    """
    return partial(_make, LogLevels.current(), make)


def _make(levels: LogLevels, make: Callable[[], T]) -> T:
    levels.apply()
    return make()
