# SPDX-License-Identifier: MIT
"""Makes the meshes of gripper, wrist camera and bracket.

Run it as ``python -m physim_drake.models.make_wrist_tools``. The SDF files beside the
meshes are written by hand. Each run writes the same files.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physim_drake.models import REALSENSE_D415, SUCTION_GRIPPER
from physim_drake.models.solids import (
    Patch,
    lofted,
    mtl_text,
    obj_text,
    oval,
    rounded,
    turned,
)

Array = NDArray[np.float64]

_COLORS = {
    "black": (0.09, 0.09, 0.10),
    "glass": (0.03, 0.03, 0.05),
    "metal": (0.66, 0.67, 0.69),
    "rubber": (0.72, 0.20, 0.10),
    "silver": (0.78, 0.79, 0.81),
}
_TILT = np.arcsin(0.1 / 0.45)  # of the camera, see sda10f_tools.dmd.yaml


def make_tools(gripper: Path, camera: Path) -> None:
    """Writes the meshes into the folders of gripper and camera, which exist."""
    gripper_parts = {"suction_gripper": _gripper(), "suction_cup": _cup()}
    _write(gripper, "suction_gripper.mtl", gripper_parts)
    camera_parts = {"realsense": _camera(), "wrist_bracket": _bracket()}
    _write(camera, "realsense_d415.mtl", camera_parts)


def _write(folder: Path, materials: str, looks: Mapping[str, list[Patch]]) -> None:
    used = {patch.material for patches in looks.values() for patch in patches}
    colors = {name: _COLORS[name] for name in sorted(used)}
    (folder / materials).write_text(mtl_text(colors), encoding="utf-8")
    for name, patches in looks.items():
        text = obj_text(patches, materials)
        (folder / f"{name}.obj").write_text(text, encoding="utf-8")


def _gripper() -> list[Patch]:
    """Flange plate, vacuum block with its hose fitting, tube, nut."""
    plate = [(0.0, 0.0), (0.04, 0.0), (0.04, 0.01), (0.015, 0.01)]
    block = [(0.022, 0.0095), (0.022, 0.054), (0.016, 0.06), (0.0, 0.06)]
    tube = [(0.008, 0.055), (0.008, 0.182), (0.0, 0.182)]
    nut = [(0.006, 0.164), (0.0115, 0.164), (0.0115, 0.173), (0.006, 0.173)]
    fitting = [(0.0065, 0.018), (0.0065, 0.030), (0.004, 0.030), (0.004, 0.036)]
    hole = [(0.004, 0.036), (0.0, 0.036)]
    sideways = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    return [
        turned(rounded(plate, [0.0, 0.001, 0.001, 0.0]), "metal"),
        turned(rounded(block, [0.0, 0.002, 0.001, 0.0]), "black"),
        turned(rounded(tube, 0.0), "metal", 16),
        turned(rounded(nut, [0.0, 0.0, 0.001, 0.0]), "metal", 6),
        *(
            turned(rounded(line, 0.0), "metal", 12).moved(sideways, (0.0, 0.0, 0.035))
            for line in (fitting, hole)
        ),
    ]


def _cup() -> list[Patch]:
    """A neck and one and a half folds, with the lip at z = 28 mm."""
    outside = [
        (0.0, 0.0),
        (0.0078, 0.0),
        (0.0078, 0.006),
        (0.0135, 0.0105),
        (0.0092, 0.0155),
        (0.0118, 0.0195),
        (0.015, 0.0265),
        (0.015, 0.028),
    ]
    inside = [(0.014, 0.028), (0.0085, 0.0195), (0.0, 0.0185)]
    radii = [0.0, 0.0, 0.001, 0.0012, 0.0012, 0.002, 0.001, 0.0003, 0.0003, 0.001, 0.0]
    return [turned(rounded([*outside, *inside], radii), "rubber", 24)]


def _camera() -> list[Patch]:
    """The case, with round ends, and the four eyes behind the front glass."""
    edge = [(0.0, -0.02005), (0.0, 0.0), (-0.0015, 0.0)]
    levels = rounded([(-0.0015, -0.02005), *edge], [0.0, 0.0014, 0.0014, 0.0])
    rings = [_stadium(0.099, 0.023, inset, z) for inset, z in levels]
    case = lofted(rings, "silver", ((0.0, 0.0, -0.02005), (0.0, 0.0, 0.0)))
    front = [_stadium(0.093, 0.017, 0.0, z) for z in (-0.001, 0.0002, 0.0002)]
    glass = lofted(front, "glass", (None, (0.0, 0.0, 0.0002)))
    eyes = [(-0.035, 0.0042), (-0.02, 0.0042), (0.010, 0.003), (0.035, 0.0042)]
    return [case, glass, *(_eye(x, radius) for x, radius in eyes)]


def _stadium(width: float, height: float, inset: float, z: float) -> Array:
    """A rectangle with round ends, (32, 3). Negative insets make it smaller."""
    radius = height / 2 + inset
    ring = oval((0.0, 0.0, z), (radius, radius), 2.0, 32)
    # Half a step off the y axis, so that no point lies between the ends.
    c, s = np.cos(np.pi / 32), np.sin(np.pi / 32)
    ring[:, :2] = ring[:, :2] @ np.array([[c, s], [-s, c]])
    ring[:, 0] += np.sign(ring[:, 0]) * (width - height) / 2
    return ring


def _eye(x: float, radius: float) -> Patch:
    rim = [(radius, 0.0), (radius, 0.0005), (radius - 0.001, 0.0005)]
    lens = [(radius - 0.001, 0.0003), (0.0, 0.0003)]
    line = rounded([*rim, *lens], 0.0)
    return turned(line, "black", 16).moved(p=(x, 0.0, 0.0))


def _bracket() -> list[Patch]:
    """A clamp about the vacuum block, an arm, and a plate behind the camera."""
    clamp = [(0.022, 0.036), (0.028, 0.036), (0.028, 0.052), (0.022, 0.052)]
    ring = turned(rounded(clamp, [0.0, 0.001, 0.001, 0.0]), "black")
    arm = _slab((0.088, 0.024, 0.008)).moved(p=(0.069, 0.0, 0.044))
    c, s = np.cos(_TILT), np.sin(_TILT)
    R = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    plate = _slab((0.023, 0.08, 0.003)).moved(R, (0.1049, 0.028, 0.0585))
    post = _slab((0.012, 0.024, 0.014)).moved(R, (0.1065, 0.0, 0.051))
    return [ring, arm, plate, post]


def _slab(size: tuple[float, float, float]) -> Patch:
    """A box with rounded corners and bevelled edges."""
    x, y, z = (edge / 2 for edge in size)
    bevel = min(0.0008, z / 2)
    levels = rounded(
        [(-bevel, -z), (0.0, -z + bevel), (0.0, z - bevel), (-bevel, z)], 0.0
    )
    rings = [oval((0, 0, h), (x + inset, y + inset), 12.0, 28) for inset, h in levels]
    return lofted(rings, "black", ((0.0, 0.0, -z), (0.0, 0.0, z)))


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the program."""
    parser = argparse.ArgumentParser(description="Make the meshes of the wrist tools.")
    default = SUCTION_GRIPPER.parent, REALSENSE_D415.parent
    parser.add_argument("--gripper", type=Path, default=default[0])
    parser.add_argument("--camera", type=Path, default=default[1])
    options = parser.parse_args(arguments)
    make_tools(options.gripper, options.camera)


if __name__ == "__main__":
    main()
