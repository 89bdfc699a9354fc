# SPDX-License-Identifier: MIT
"""The machines that do the work."""

from __future__ import annotations

from enum import StrEnum


class Engine(StrEnum):
    """Processes of this machine, or those of a Ray cluster's machines."""

    LOCAL = "local"
    RAY = "ray"
