# SPDX-License-Identifier: MIT
"""What commands tell: results on stdout or in files, the rest on stderr."""

from __future__ import annotations

import logging
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from physim_drake.parallel.log_levels import LogLevels

if TYPE_CHECKING:
    from rich.console import Console


class LogLevelName(StrEnum):
    """The least severity of the messages from within that are shown."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


def set_log_level(name: LogLevelName) -> LogLevelName:
    """Lets loggers, Drake's among them, write to stderr, here and in workers."""
    level = getattr(logging, name.upper())
    # Drake's warnings are about models that we ship and know.
    known = name is LogLevelName.WARNING
    # Its first import, whenever that is, sets the level of its own logger.
    import pydrake.common  # noqa: F401

    LogLevels({"": level, "drake": logging.ERROR if known else level}).apply()
    return name


def messages(quiet: bool) -> Console:
    """The console for how far a command is: stderr, or nothing if quiet."""
    from rich.console import Console

    return Console(stderr=True, highlight=False, quiet=quiet)


def output_json(path: Path, value: Any) -> bool:
    """Writes a value to a file, or for `-` to stdout, which is then all of the output.

    Returns:
        whether it went to stdout.

    Raises:
        InputError: if the file cannot be written.
    """
    import json

    from physim_drake.storage.files import write_atomically

    text = json.dumps(value, indent=1, allow_nan=False)
    if str(path) == "-":
        typer.echo(text)
        return True
    with write_atomically(path) as file:
        file.write(f"{text}\n")
    return False


def counted(number: int, noun: str) -> str:
    """A number of things, as in "1 image" and "2 images"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
