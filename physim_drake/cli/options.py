# SPDX-License-Identifier: MIT
"""Options that commands share, and what their values mean."""

from __future__ import annotations

import logging
import math
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from physim_drake.errors import InputError
from physim_drake.parallel.engine import Engine
from physim_drake.parallel.log_levels import LogLevels

if TYPE_CHECKING:
    from rich.console import Console

Split = Annotated[str, typer.Option(help="Folder of the images, below DATASET.")]
"""Of commands that read a dataset."""

DatasetModels = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR", help="Folder of the object models; by default DATASET/models."
    ),
]
"""Of commands that read a dataset and need its objects."""

LibraryFolder = Annotated[
    Path,
    typer.Option(
        metavar="DIR", help="Folder of the object models.", show_default="apc11"
    ),
]
"""Of commands that need no dataset; `APC11` by default."""


class Container(StrEnum):
    """Names of `ContainerName`, which costs too much to import here."""

    TABLE = "table"
    TOTE = "tote"
    SHELF = "shelf"


ContainerOption = Annotated[
    Container, typer.Option("--container", help="What the objects stand on or in.")
]
"""Of commands that generate scenes."""

Masks = Annotated[
    bool,
    typer.Option(
        "--masks", help="Take the dataset's masks (mask_visib) instead of detections."
    ),
]
"""Of commands that estimate poses in a dataset."""

Expansions = Annotated[
    int,
    typer.Option(
        min=1,
        help="Budget of the search: the states that it tries for each group of "
        "objects.",
    ),
]
"""Of commands that search."""

Hypotheses = Annotated[
    int,
    typer.Option(min=1, help="Poses of each object that the search chooses from."),
]
"""Of commands that search."""

NetworkWeights = Annotated[
    Path,
    typer.Option(
        "--weights",
        metavar="FILE",
        help="Weights of the network; physim-drake train writes them.",
        show_default="those of apc11",
    ),
]
"""Of commands that cannot do without a network; `DETECTOR` by default."""

Seed = Annotated[int, typer.Option(min=0, help="Seed of all random choices.")]
"""Of commands that choose at random."""

EngineOption = Annotated[
    Engine,
    typer.Option(
        "--engine",
        help="Where the work is done: local is this machine, ray the Ray cluster that "
        "the variable RAY_ADDRESS names. The results are the same.",
    ),
]
"""Of commands whose work can be divided."""

Plain = Annotated[
    bool,
    typer.Option(
        "--plain",
        help="Search as the paper does: make all expansions, however little they gain, "
        "and search only once.",
    ),
]
"""Of commands that search."""

Quiet = Annotated[
    bool,
    typer.Option("--quiet", "-q", help="Show no progress, only results and errors."),
]
"""Of commands that take long: `messages(quiet)` keeps to it."""


class LogLevelName(StrEnum):
    """How much of what goes on within is told."""

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


LogLevel = Annotated[
    LogLevelName,
    typer.Option(
        "--log-level",
        callback=set_log_level,
        help="Show messages from within, Drake's included, from this severity on.",
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

    from physim_drake.storage.files import write_atomically

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
