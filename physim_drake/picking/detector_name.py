# SPDX-License-Identifier: MIT
"""The names of the detectors; light to import, for the command line."""

from __future__ import annotations

from enum import StrEnum


class DetectorName(StrEnum):
    """What says which objects are in an image, and where."""

    NETWORK = "network"
    ORACLE = "oracle"
