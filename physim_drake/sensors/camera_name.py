# SPDX-License-Identifier: MIT
"""The names of the cameras; light to import, for the command line."""

from __future__ import annotations

from enum import StrEnum


class CameraName(StrEnum):
    """The presets."""

    D415 = "d415"
    D435 = "d435"
    SR300 = "sr300"
