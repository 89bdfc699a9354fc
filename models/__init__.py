# SPDX-License-Identifier: MIT
"""Object sets that come with physim-drake."""

from __future__ import annotations

from pathlib import Path

APC11 = Path(__file__).parent / "apc11"
"""Folder of the eleven objects of the paper: meshes, SDF files, ``library.yaml``."""
