# SPDX-License-Identifier: MIT
"""Where work is done."""

from __future__ import annotations

from enum import StrEnum


class Engine(StrEnum):
    """Processes of this machine, or those of a Ray cluster's machines."""

    LOCAL = "local"
    RAY = "ray"
