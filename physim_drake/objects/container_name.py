# SPDX-License-Identifier: MIT
"""The names of the containers; light to import, for the command line."""

from __future__ import annotations

from enum import StrEnum


class ContainerName(StrEnum):
    """The containers that come with the package."""

    TABLE = "table"
    TOTE = "tote"
    SHELF = "shelf"
