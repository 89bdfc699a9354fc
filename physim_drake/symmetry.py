# SPDX-License-Identifier: MIT
"""Stub."""

import trimesh

from physim_drake.poses import SymmetryGroup


def detect_symmetry(mesh: trimesh.Trimesh) -> SymmetryGroup:
    return SymmetryGroup()
