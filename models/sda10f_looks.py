# SPDX-License-Identifier: MIT
"""Visual surfaces of the SDA10F's links.

Every arm link is a head beside the joint's plane, a tube along the arm and a neck
between them. They are drawn in a frame whose z axis runs along the tube, away from the
joint, and whose y axis is that of the head.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physim_drake.models.sda10f_table import Triple
from physim_drake.models.solids import Patch, lofted, oval, rounded, turned

Array = NDArray[np.float64]

COLORS: dict[str, Triple] = {
    "blue": (0.06, 0.25, 0.55),
    "white": (0.88, 0.89, 0.90),
    "dark": (0.10, 0.11, 0.13),
    "metal": (0.62, 0.63, 0.65),
}

_GAP = 0.0012  # m, on each side of a seam
_UP_TO_Y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
_UP_TO_MINUS_Y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
_EVEN = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True)
class _ArmLink:
    """Sizes of an arm link, m.

    Attributes:
        side: sign of the head's y, +1 or -1.
        head: radius, radius of its cover, and length of the head.
        neighbor: radius of the head on the other side of the joint's plane.
        tube: radius of the tube.
        neck_end: start of the tube along the arm.
        end: end of the tube, at a seam.
        spigot: length, beyond the seam, of the part that turns in the next tube.
        colors: colours of body and cover.
    """

    side: int
    head: tuple[float, float, float]
    neighbor: float
    tube: float
    neck_end: float
    end: float
    spigot: float
    colors: tuple[str, str]


_ARM: dict[str, _ArmLink] = {
    "link_1_s": _ArmLink(
        -1, (0.085, 0.079, 0.105), 0.091, 0.085, 0.145, 0.16, 0.015, ("blue", "white")
    ),
    "link_2_l": _ArmLink(
        1, (0.091, 0.066, 0.100), 0.085, 0.068, 0.160, 0.216, 0.0, ("white", "blue")
    ),
    "link_3_e": _ArmLink(
        1, (0.067, 0.061, 0.085), 0.070, 0.068, 0.125, 0.144, 0.037, ("blue", "white")
    ),
    "link_4_u": _ArmLink(
        -1, (0.070, 0.048, 0.080), 0.067, 0.057, 0.130, 0.239, 0.0, ("white", "blue")
    ),
    "link_5_r": _ArmLink(
        -1, (0.055, 0.048, 0.073), 0.057, 0.057, 0.105, 0.121, 0.034, ("blue", "white")
    ),
    "link_6_b": _ArmLink(
        1, (0.057, 0.051, 0.073), 0.055, 0.052, 0.105, 0.141, 0.0, ("white", "blue")
    ),
}

# Height, front, back, half width (m), and how square it is.
_TORSO: tuple[tuple[float, ...], ...] = (
    (-0.312, 0.119, -0.119, 0.119, 2.0),
    (-0.27, 0.119, -0.119, 0.119, 2.0),
    (-0.21, 0.120, -0.116, 0.117, 2.1),
    (-0.16, 0.130, -0.107, 0.115, 2.4),
    (-0.12, 0.149, -0.093, 0.114, 2.8),
    (-0.08, 0.178, -0.076, 0.115, 3.3),
    (-0.04, 0.206, -0.060, 0.117, 3.6),
    (0.0, 0.219, -0.048, 0.118, 3.8),
    (0.04, 0.213, -0.042, 0.118, 3.8),
    (0.080, 0.187, -0.039, 0.116, 3.8),
)


def link_looks() -> dict[str, list[Patch]]:
    """The surfaces of each link, in its frame. Names of arm links are without side."""
    looks = {"torso_base_link": _base(), "torso_link_b1": _torso()}
    for n, (name, sizes) in enumerate(_ARM.items(), start=1):
        parts = _arm_link(sizes)
        looks[name] = [part.moved(_EVEN) for part in parts] if n % 2 == 0 else parts
    looks["link_7_t"] = _flange()
    return looks


def _arm_link(sizes: _ArmLink) -> list[Patch]:
    return [*_head(sizes), _neck(sizes), *_tube(sizes)]


def _head(sizes: _ArmLink) -> list[Patch]:
    """The barrel beside the joint's plane, its cover with bolts, and the seam."""
    radius, lid_radius, length = sizes.head
    body, cover = sizes.colors
    step = 0.010
    barrel = rounded(
        [
            (radius - 0.004, _GAP),
            (radius, _GAP),
            (radius, 0.4 * length),
            (lid_radius + 0.005, length - step),
            (lid_radius - 0.005, length - step),
        ],
        [0.0, 0.001, 0.3 * length, 0.003, 0.0],
        3,
    )
    lid = rounded(
        [(lid_radius, length - step), (lid_radius, length), (0.0, length)],
        [0.0, 0.006, 0.0],
    )
    seam = [(radius - 0.004, -_GAP), (radius - 0.004, 2 * _GAP)]
    parts = [turned(barrel, body), turned(lid, cover), turned(seam, "dark", 24)]
    parts += _bolts(lid_radius - 0.012, length, 6)
    R = _UP_TO_Y if sizes.side > 0 else _UP_TO_MINUS_Y
    return [part.moved(R) for part in parts]


def _bolts(circle: float, z: float, count: int, radius: float = 0.0035) -> list[Patch]:
    """Bolt heads on a circle about z."""
    height = 0.0012
    line = [(radius, z - 0.001), (radius, z + height), (0.0, z + height)]
    bolt = turned(rounded(line, 0.0), "dark", 8)
    angles = 2 * np.pi * (np.arange(count) + 0.5) / count
    return [bolt.moved(p=(circle * np.cos(a), circle * np.sin(a), 0.0)) for a in angles]


def _neck(sizes: _ArmLink) -> Patch:
    """From the side of the head to the whole round of the tube.

    It keeps clear of the other link's head, which turns beside this one.
    """
    radius, _, length = sizes.head
    clear = max(sizes.neighbor, radius) + 0.003
    top, tube = length - 0.020, sizes.tube
    sharp = np.array([0.0, 0.5 * clear, clear])
    curve = np.linspace(clear, sizes.neck_end, 8)[1:]
    rings = []
    for z in [*sharp, *curve]:
        whole = min(z / (0.72 * sizes.neck_end), 1.0)
        drop = (z - clear) / (sizes.neck_end - clear)
        upper = _eased(top, tube, whole)
        lower = _eased(_GAP, -tube, max(drop, 0.0))
        width = _eased(0.985 * radius, tube, whole)
        power = _eased(3.2, 2.0, whole)
        middle, half = (upper + lower) / 2, (upper - lower) / 2
        rings.append(oval((0.0, sizes.side * middle, z), (width, half), power))
    ends = (rings[0].mean(axis=0), rings[-1].mean(axis=0))
    return lofted(rings, sizes.colors[0], ends)


def _eased(start: float, stop: float, t: float) -> float:
    """From start (t = 0) to stop (t = 1), level at both."""
    return start + (stop - start) * t * t * (3 - 2 * t)


def _tube(sizes: _ArmLink) -> list[Patch]:
    """The round part, up to the seam before the next link."""
    r, end = sizes.tube, sizes.end - _GAP
    shell = rounded(
        [(r, sizes.neck_end), (r, end), (r - 0.006, end)], [0.0, 0.002, 0.0]
    )
    ring = [(r - 0.005, end - 0.001), (r - 0.005, end + 2 * _GAP + sizes.spigot)]
    return [turned(shell, sizes.colors[0]), turned(ring, "dark", 24)]


def _flange() -> list[Patch]:
    disc = rounded(
        [(0.0, -0.014), (0.04, -0.014), (0.04, 0.0), (0.0125, 0.0), (0.0125, -0.005)],
        [0.0, 0.001, 0.001, 0.0, 0.0],
    )
    plug = turned([(0.0125, -0.005), (0.0, -0.005)], "dark", 24)
    return [turned(disc, "metal"), plug, *_bolts(0.0315, -0.0012, 8, 0.003)]


def _torso() -> list[Patch]:
    """A waist that widens to the shoulders' cross tube, under a lid."""
    rings = [_torso_ring(row, 1.0) for row in _TORSO]
    rings += [
        _torso_ring((0.080 + 0.053 * np.sin(t), *_TORSO[-1][1:]), 0.4 + 0.6 * np.cos(t))
        for t in np.linspace(0.0, np.pi / 2, 6)[1:]
    ]
    body = lofted(rings, "white", (None, rings[-1].mean(axis=0)))
    waist = turned([(0.116, -0.32), (0.116, -0.30)], "dark")
    lid = _block((0.074, 0.0), (0.055, 0.058), 0.120, 0.138, 0.004, "blue")
    return [body, waist, lid, *_shoulders()]


def _torso_ring(row: tuple[float, ...], scale: float) -> Array:
    z, front, back, half_width, power = row
    middle, half = (front + back) / 2, (front - back) / 2
    return oval((middle, 0.0, z), (half * scale, half_width * scale), power, 40)


def _shoulders() -> list[Patch]:
    collar = rounded(
        [(0.104, 0.10), (0.104, 0.129), (0.088, 0.129), (0.088, 0.12)],
        [0.0, 0.003, 0.001, 0.0],
    )
    one = turned(collar, "metal")
    return [one.moved(R, (0.1, 0.0, 0.0)) for R in (_UP_TO_Y, _UP_TO_MINUS_Y)]


def _base() -> list[Patch]:
    """A foot plate, and on it a column that becomes round towards the waist."""
    plate = _block((-0.093, 0.0), (0.25, 0.25), -1.2, -1.17, 0.004, "dark")
    column = lofted(
        [_column_ring(z) for z in (-1.171, -1.165, -1.15, -1.13, -1.10, -1.05)]
        + [_column_ring(z) for z in (-0.60, -0.50, -0.42, -0.36, -0.345, -0.345)],
        "blue",
        (None, (0.0, 0.0, -0.345)),
    )
    collar = rounded(
        [(0.126, -0.346), (0.126, -0.309), (0.105, -0.309)], [0.0, 0.005, 0.0]
    )
    socket = _block((-0.06, 0.0), (0.05, 0.09), -0.03, 0.0, 0.006, "metal")
    # Cable entry on the column's back.
    on_back = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    socket = socket.moved(on_back, (-0.160, 0.0, -0.92))
    return [plate, column, turned(collar, "metal"), socket, *_foot_bolts()]


def _column_ring(z: float) -> Array:
    t = float(np.clip((z + 0.60) / 0.24, 0.0, 1.0))
    flare = 0.025 * np.exp((-1.171 - z) / 0.025)
    half = 0.138 - 0.012 * (z + 1.2) + flare
    return oval((-0.01 + 0.01 * t, 0.0, z), (half, half), _eased(7.0, 2.0, t), 40)


def _foot_bolts() -> list[Patch]:
    corners = [(-0.093 + x, y, 0.0) for x in (-0.215, 0.215) for y in (-0.215, 0.215)]
    (bolt,) = _bolts(0.0, -1.17, 1, 0.014)
    return [bolt.moved(p=corner) for corner in corners]


def _block(
    center: tuple[float, float],
    halves: tuple[float, float],
    low: float,
    high: float,
    bevel: float,
    material: str,
) -> Patch:
    """A box with rounded corners and a rounded upper edge."""
    levels = rounded([(0.0, low), (0.0, high), (-2 * bevel, high)], [0, bevel, 0])
    rings = [
        oval((*center, z), (halves[0] + inset, halves[1] + inset), 14.0, 40)
        for inset, z in levels
    ]
    return lofted(rings, material, (None, (*center, high)))
