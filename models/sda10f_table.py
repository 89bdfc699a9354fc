# SPDX-License-Identifier: MIT
"""The Motoman SDA10F in numbers: joints, links, masses, drives.

Lengths are in m, angles in rad, masses in kg. ``motoman_sda10f/README.md`` has the
sources and assumptions. The links of both arms are equal. The right arm's frames are
turned so that the same joint angles mirror the left arm's posture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Triple = tuple[float, float, float]

_QUARTER, _HALF = math.pi / 2, math.pi


@dataclass(frozen=True)
class JointRow:
    """A joint, which is fixed if it has no drive.

    Attributes:
        name, parent, child: names as in the URDF.
        xyz, rpy: pose of the joint's frame in the parent link, m and rad.
        axis: axis in the joint's frame.
        limit: largest angle to either side, rad.
        drive: motor and gear, or None.
    """

    name: str
    parent: str
    child: str
    xyz: Triple = (0.0, 0.0, 0.0)
    rpy: Triple = (0.0, 0.0, 0.0)
    axis: Triple = (0.0, 0.0, 1.0)
    limit: float = 0.0
    drive: Drive | None = None


@dataclass(frozen=True)
class Drive:
    """Limits of a joint's motor and gear.

    Attributes:
        speed: largest speed, rad/s.
        acceleration: largest acceleration, rad/s^2.
        effort: largest torque, N m.
        gear_ratio: turns of the motor for one of the joint.
        rotor_inertia: inertia of the rotor, at the motor, kg m^2.
    """

    speed: float
    acceleration: float
    effort: float
    gear_ratio: float
    rotor_inertia: float


@dataclass(frozen=True)
class Primitive:
    """A collision shape.

    Attributes:
        size: (radius, length) of a cylinder, or edges of a box, m.
        xyz: centre in the link's frame, m.
        axis: axis of a cylinder.
    """

    size: tuple[float, ...]
    xyz: Triple
    axis: Literal["x", "y", "z"] = "z"


@dataclass(frozen=True)
class LinkRow:
    """A link.

    Attributes:
        mass: mass, kg.
        shapes: collision shapes, over which the mass is spread evenly.
    """

    mass: float
    shapes: tuple[Primitive, ...]


# Speed limits are the manufacturer's. The README explains the rest.
_TORSO = Drive(math.radians(130), 4.5, 400.0, 160.0, 6.0e-5)
_SHOULDER = Drive(math.radians(170), 10.0, 400.0, 160.0, 6.0e-5)
_ELBOW = Drive(math.radians(170), 10.0, 170.0, 160.0, 2.6e-5)
_WRIST = Drive(math.radians(200), 12.0, 60.0, 120.0, 1.0e-5)
_FLANGE = Drive(math.radians(400), 24.0, 30.0, 80.0, 1.0e-5)

_ARM_LINKS: dict[str, LinkRow] = {
    "link_1_s": LinkRow(
        12.73,
        (
            Primitive((0.085, 0.125), (0.0, 0.0, 0.1125)),
            Primitive((0.085, 0.105), (0.0, -0.0525, 0.0), "y"),
        ),
    ),
    "link_2_l": LinkRow(
        9.28,
        (
            Primitive((0.068, 0.156), (0.0, 0.138, 0.0), "y"),
            Primitive((0.091, 0.1), (0.0, 0.0, 0.05)),
        ),
    ),
    "link_3_e": LinkRow(
        7.10,
        (
            Primitive((0.068, 0.121), (0.0, 0.0, 0.1205)),
            Primitive((0.067, 0.085), (0.0, 0.0425, 0.0), "y"),
        ),
    ),
    "link_4_u": LinkRow(
        6.26,
        (
            Primitive((0.058, 0.189), (0.0, 0.1445, 0.0), "y"),
            Primitive((0.070, 0.08), (0.0, 0.0, -0.04)),
        ),
    ),
    "link_5_r": LinkRow(
        4.43,
        (
            Primitive((0.058, 0.105), (0.0, 0.0, 0.1025)),
            Primitive((0.055, 0.073), (0.0, -0.0365, 0.0), "y"),
        ),
    ),
    "link_6_b": LinkRow(
        3.56,
        (
            Primitive((0.056, 0.105), (0.0, 0.1025, 0.0), "y"),
            Primitive((0.057, 0.073), (0.0, 0.0, 0.0365)),
        ),
    ),
    "link_7_t": LinkRow(0.12, (Primitive((0.04, 0.014), (0.0, 0.0, -0.007)),)),
}

_FOOT_HEIGHT = 0.08


def links() -> dict[str, LinkRow]:
    """Every link that has a shape."""
    rows = {
        "torso_base_link": LinkRow(
            109.18,
            (
                Primitive((0.5, 0.5, _FOOT_HEIGHT), (-0.093, 0.0, -1.16)),
                Primitive((0.29, 0.29, 0.813), (-0.01, 0.0, -0.7135)),
            ),
        ),
        "torso_link_b1": LinkRow(
            23.86,
            (
                Primitive((0.122, 0.258), (0.1, 0.0, 0.0), "y"),
                Primitive((0.122, 0.456), (0.0, 0.0, -0.092)),
            ),
        ),
    }
    for side in ("left", "right"):
        rows |= {f"arm_{side}_{name}": row for name, row in _ARM_LINKS.items()}
    return rows


def joints() -> tuple[JointRow, ...]:
    """Every joint, parents before children."""
    waist = JointRow(
        "torso_joint_b1",
        "torso_base_link",
        "torso_link_b1",
        limit=math.radians(170),
        drive=_TORSO,
    )
    base = JointRow("base_link_torso", "base_link", "torso_base_link", (0.0, 0.0, 1.2))
    return base, waist, *_arm("left", 1.0), *_arm("right", -1.0)


def _arm(side: str, sign: float) -> list[JointRow]:
    """The joints of an arm. `sign` is the sign of the arm's y."""
    turned = (_QUARTER, 0.0, 0.0 if sign > 0 else -_HALF)
    up, down = (_QUARTER, 0.0, 0.0), (-_QUARTER, 0.0, 0.0)
    back, ahead = (0.0, 0.0, -sign), (0.0, 0.0, sign)
    here, along = (0.0, 0.0, 0.0), (0.0, 0.36, 0.0)
    rows = [
        ("1_s", (0.1, sign * 0.265, 0.0), turned, back, 180, _SHOULDER),
        ("2_l", here, down, back, 110, _SHOULDER),
        ("3_e", along, up, back, 170, _ELBOW),
        ("4_u", here, down, ahead, 135, _ELBOW),
        ("5_r", along, up, ahead, 180, _WRIST),
        ("6_b", here, down, ahead, 110, _WRIST),
        ("7_t", (0.0, 0.155, 0.0), down, back, 180, _FLANGE),
    ]
    parent, chain = "torso_link_b1", []
    for axis_name, xyz, rpy, axis, degrees, drive in rows:
        child = f"arm_{side}_link_{axis_name}"
        name, limit = f"arm_{side}_joint_{axis_name}", math.radians(degrees)
        chain.append(JointRow(name, parent, child, xyz, rpy, axis, limit, drive))
        parent = child
    tool = f"arm_{side}_link_tool0"
    flange = (0.0, 0.0, _HALF)
    chain.append(JointRow(f"arm_{side}_joint_tool0", parent, tool, here, flange))
    return chain
