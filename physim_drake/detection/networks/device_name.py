# SPDX-License-Identifier: MIT
"""The names of the devices; light to import, for the command line."""

from __future__ import annotations

from enum import StrEnum


class DeviceName(StrEnum):
    """Kinds of devices."""

    AUTO = "auto"
    CPU = "cpu"
    CUDA = "cuda"
    MPS = "mps"
