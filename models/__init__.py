# SPDX-License-Identifier: MIT
"""Models that come with physim-drake: sets of objects, containers, robots."""

from __future__ import annotations

from pathlib import Path

APC11 = Path(__file__).parent / "apc11"
"""Folder of the eleven objects of the paper: meshes, SDF files, ``library.yaml``."""

DETECTOR = APC11 / "detector.safetensors"
"""Weights of a network that finds these objects: Faster R-CNN, with masks."""

PACKAGE_XML = Path(__file__).parent / "package.xml"
"""Names this folder ``package://physim_drake_models``; add it to a parser with
``parser.package_map().AddPackageXml(str(PACKAGE_XML))`` before loading directives."""

SDA10F = Path(__file__).parent / "motoman_sda10f"
"""Folder of the dual-arm robot: URDF and directives, alone and with its tools."""

SUCTION_GRIPPER = Path(__file__).parent / "suction_gripper" / "suction_gripper.sdf"
"""The vacuum gripper."""

REALSENSE_D415 = Path(__file__).parent / "realsense_d415" / "realsense_d415.sdf"
"""The wrist camera."""
