# SPDX-License-Identifier: MIT
"""Options that commands share, and what their values mean."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from physim_drake.errors import InputError

Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="No progress; results and errors only.")
]
"""Of commands that take long: `Console(stderr=True, quiet=quiet)` keeps to it."""


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
