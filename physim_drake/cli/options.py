# SPDX-License-Identifier: MIT
"""Options that commands share, and what their values mean."""

from __future__ import annotations

import logging
import math
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from physim_drake.engine import Engine
from physim_drake.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

EngineOption = Annotated[
    Engine,
    typer.Option(
        "--engine",
        help="Where the work is done: ray is on the cluster that the variable "
        "RAY_ADDRESS names, else on this machine. The results are the same.",
    ),
]
"""Of commands whose work can be divided."""

Plain = Annotated[
    bool,
    typer.Option(
        "--plain",
        help="Search as the paper does: all expansions, however little they gain, and "
        "once only.",
    ),
]
"""Of commands that search."""

Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="No progress; results and errors only.")
]
"""Of commands that take long: `messages(quiet)` keeps to it."""


class LogLevelName(StrEnum):
    """How much of what goes on within is told."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


def set_log_level(name: LogLevelName) -> LogLevelName:
    """Lets the loggers of this process, Drake's among them, write to stderr."""
    level = getattr(logging, name.upper())
    logging.basicConfig(level=level, format="%(levelname)s %(name)s: %(message)s")
    logging.getLogger().setLevel(level)
    # Drake's warnings are about models that we ship and know.
    known = name is LogLevelName.WARNING
    logging.getLogger("drake").setLevel(logging.ERROR if known else level)
    return name


LogLevel = Annotated[
    LogLevelName,
    typer.Option(
        "--log-level",
        callback=set_log_level,
        help="Least severity of messages from within, Drake's included.",
    ),
]
"""Of commands that take long; its callback does all, so that none needs the value."""


def messages(quiet: bool) -> Console:
    """Where commands say how far they are: stderr, or nowhere."""
    from rich.console import Console

    return Console(stderr=True, highlight=False, quiet=quiet)


def write_json(path: Path, value: Any) -> bool:
    """Writes a value to a file, or for `-` to stdout, which is then all of the output.

    Returns:
        whether it went to stdout.

    Raises:
        InputError: where the file cannot be written.
    """
    import json

    from physim_drake.files import write_atomically

    text = json.dumps(value, indent=1, allow_nan=False)
    if str(path) == "-":
        typer.echo(text)
        return True
    with write_atomically(path) as file:
        file.write(f"{text}\n")
    return False


def surface_height(text: str) -> float | None:
    """The height that `--surface auto|Z_METRES` gives, m, or None for auto.

    Raises:
        InputError: where it is neither.
    """
    if text == "auto":
        return None
    try:
        height = float(text)
    except ValueError:
        height = math.nan
    if not math.isfinite(height):
        raise InputError(
            "--surface", f"is {text!r}", "give auto, or the height in metres"
        )
    return height
