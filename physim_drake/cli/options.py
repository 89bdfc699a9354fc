# SPDX-License-Identifier: MIT
"""Values of options that commands share."""

from __future__ import annotations

import math

from physim_drake.errors import InputError


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
