# SPDX-License-Identifier: MIT
"""A vacuum cup: when its lip seals on a surface, and what the vacuum then pulls with.

Frame G is the cup's: origin at the lip's centre, z out towards the object. Surfaces are
unions of convex pieces, which are what objects touch with, so that the lip feels the
same surface as the contact does. Everything here is arrays in, arrays out;
docs/suction-gripper.md derives the equations and reports what was measured.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from physim_drake.compiled import compiled
from physim_drake.errors import InputError
from physim_drake.poses import Array, inverse, transform_points

_POSITIVE = (
    *("lip_radius", "vacuum_pressure", "stroke", "build_up_time", "vent_time"),
    *("period", "stiffness", "stop_stiffness"),
)
_NOT_NEGATIVE = (
    *("lip_reach", "lip_conformity", "leak_ratio"),
    *("friction", "dissipation", "relaxation_time"),
)


@dataclass(frozen=True)
class SuctionConfig:
    """One cup, its pump and its valve. The defaults are those of a 30 mm bellows cup.

    Attributes:
        lip_radius: radius of the circle that seals, m.
        vacuum_pressure: below the atmosphere's, what the pump reaches on a tight lip,
            Pa.
        lip_reach: the lip is sucked on to a surface no farther ahead than this, m.
        lip_conformity: and lies on one that leaves its mean plane by no more, m.
        stroke: the bellows gives way by this much before it is a block, m.
        max_tilt: it follows a surface tilted by no more against its axis, rad.
        max_slope: a lip point does not lie on a surface steeper than this, rad.
        lip_points: number of points of the lip that are tested.
        leak_ratio: what an open lip lets in at full vacuum, over what the pump moves
            at none.
        build_up_time: time constant of evacuating a tight cup, s.
        vent_time: time constant of venting it, s.
        holding_level: the vacuum switch closes at this level, 0..1.
        period: time between tests of the seal, s; best the plant's time step or a
            multiple of it.
        stiffness: stiffness of the bellows, N/m.
        stop_stiffness: stiffness of the block that it ends on, N/m.
        friction: friction of the cup's rubber, which Drake combines with the object's.
        dissipation: dissipation of the rubber, Hunt and Crossley's, s/m.
        relaxation_time: relaxation time of the rubber, s, in place of dissipation in
            SAP.
    """

    lip_radius: float = 0.015
    vacuum_pressure: float = 50e3
    lip_reach: float = 0.001
    lip_conformity: float = 0.002
    stroke: float = 0.005
    max_tilt: float = math.radians(15.0)
    max_slope: float = math.radians(45.0)
    lip_points: int = 24
    leak_ratio: float = 16.0
    build_up_time: float = 0.04
    vent_time: float = 0.02
    holding_level: float = 0.6
    period: float = 0.005
    stiffness: float = 2e3
    stop_stiffness: float = 6e4
    friction: float = 0.8
    dissipation: float = 20.0
    relaxation_time: float = 0.02

    def __post_init__(self) -> None:
        for name in _POSITIVE:
            self._require(name, getattr(self, name) > 0, "be positive")
        for name in _NOT_NEGATIVE:
            self._require(name, getattr(self, name) >= 0, "not be negative")
        for name in ("max_tilt", "max_slope"):
            acute = 0 < getattr(self, name) < math.pi / 2
            self._require(name, acute, "be an acute angle in radians")
        self._require("lip_points", self.lip_points >= 6, "be at least 6")
        within = 0 < self.holding_level < 1
        self._require("holding_level", within, "be between 0 and 1")

    def _require(self, field: str, holds: bool, must: str) -> None:
        if not holds:
            value = getattr(self, field)
            problem = f"is {value}, must {must}"
            raise InputError("SuctionConfig", problem, field=field)

    @property
    def max_force(self) -> float:
        """Pull of the full vacuum, N."""
        return self.vacuum_pressure * math.pi * self.lip_radius**2

    @cached_property
    def p_GL(self) -> Array:
        """Points of the lip, (lip_points, 3), m."""
        angles = 2 * np.pi * np.arange(self.lip_points) / self.lip_points
        circle = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
        return np.asarray(self.lip_radius * circle)


@dataclass(frozen=True, eq=False)
class Surface:
    """A solid as a union of convex pieces, each the intersection of half-spaces.

    Attributes:
        normals: outward, of all planes, piece after piece, (F, 3).
        offsets: a point p of a piece has normals @ p <= offsets, (F,), m.
        ends: index behind each piece's last plane, (P,).
        radius: greatest distance of a point from the origin, m; may be infinite.
    """

    normals: Array
    offsets: Array
    ends: NDArray[np.int64]
    radius: float

    @staticmethod
    def from_planes(pieces: Sequence[Array], radius: float) -> Surface:
        """Joins pieces given as planes (F, 4): outward normal, offset."""
        planes = np.concatenate(pieces).astype(float)
        return Surface(
            np.ascontiguousarray(planes[:, :3]),
            np.ascontiguousarray(planes[:, 3]),
            np.cumsum([len(piece) for piece in pieces]),
            radius,
        )


@dataclass(frozen=True, eq=False)
class Seal:
    """How a lip lies on a surface.

    Attributes:
        index: index of the surface that it lies on; None if it touches no surface.
        leak: share of the lip that is open, 0..1.
        normal: normal of the plane the lip lies in, out of the surface, (3,), in the
            surface's frame.
        gap: from the lip's centre ahead to that plane, m, negative if the cup is
            compressed.
    """

    index: int | None
    leak: float
    normal: Array
    gap: float


NO_SEAL = Seal(None, 1.0, np.zeros(3), 0.0)
"""No surface is in reach."""


def find_seal(
    X_WG: Array,
    X_WO: Sequence[Array],
    surfaces: Sequence[Surface],
    config: SuctionConfig,
) -> Seal:
    """Tests the lip against surfaces in reach.

    A line through each lip point, along the cup's axis, meets the surfaces; the
    foremost counts. The lip lies on the surface that most of its points touch, and
    what touches another one leaks.

    Args:
        X_WG: the cup, (4, 4).
        X_WO: a pose for each surface, (4, 4).
        surfaces: what the cup may lie on.
        config: the cup's.
    """
    reach = config.lip_radius + config.lip_reach + 2 * config.stroke
    back = -2 * config.stroke
    candidates, found = [], []
    for n, (X, surface) in enumerate(zip(X_WO, surfaces, strict=True)):
        if math.dist(X[:3, 3], X_WG[:3, 3]) > surface.radius + reach:
            continue
        X_OG = inverse(X) @ X_WG
        p_OL = transform_points(X_OG, config.p_GL)
        candidates.append((n, X_OG[:3, :3]))
        found.append(cast_lines(surface, p_OL, X_OG[:3, 2], back))
    if not candidates:
        return NO_SEAL
    gaps = np.stack([gap for gap, _ in found])
    if gaps.min() > config.lip_reach:
        return NO_SEAL
    first = gaps.argmin(axis=0)
    foremost = first == np.arange(len(found))[:, None]
    touches = foremost & (gaps >= back) & (gaps <= config.lip_reach)
    best = int(touches.sum(axis=1).argmax())
    index, R_OG = candidates[best]
    touching = touches[best] & (
        -found[best][1] @ R_OG[:, 2] >= math.cos(config.max_slope)
    )
    if not touching.any():
        return NO_SEAL
    leak, normal_G, gap = _lie_on_plane(gaps[best], touching, config)
    return Seal(index, leak, R_OG @ normal_G, gap)


def _lie_on_plane(
    gaps: Array, touching: NDArray[np.bool_], config: SuctionConfig
) -> tuple[float, Array, float]:
    """Fits the plane gap = a + b x + c y: the open share, its normal in G, and a."""
    if touching.sum() < 3:
        return 1.0, np.array([0.0, 0.0, -1.0]), 0.0
    terms = config.p_GL[touching].copy()
    terms[:, 2] = 1.0
    # Three points of a circle are never in line, so the plane is determined.
    b, c, a = np.linalg.solve(terms.T @ terms, terms.T @ gaps[touching])
    normal = np.array([b, c, -1.0]) / math.sqrt(1 + b * b + c * c)
    if -normal[2] < math.cos(config.max_tilt):
        return 1.0, normal, float(a)
    residuals = np.abs(terms @ [b, c, a] - gaps[touching])
    sealed = int((residuals <= config.lip_conformity).sum())
    return 1.0 - sealed / len(gaps), normal, float(a)


def cast_lines(
    surface: Surface, p_O: Array, direction_O: Array, back: float
) -> tuple[Array, Array]:
    """Where parallel lines enter a solid.

    Args:
        surface: surface in frame O.
        p_O: a point on each line, (N, 3), m.
        direction_O: direction of all lines, unit, (3,).
        back: a piece that a line leaves before this is behind, and not met, m.

    Returns:
        Distances along the direction to where the first piece is entered, (N,), m,
        negative behind the point and infinite if it meets none; outward normals there,
        (N, 3).
    """
    gaps = np.full(len(p_O), np.inf)
    normals = np.zeros((len(p_O), 3))
    _cast(
        surface.normals,
        surface.offsets,
        surface.ends,
        np.ascontiguousarray(p_O, dtype=float),
        np.ascontiguousarray(direction_O, dtype=float),
        back,
        gaps,
        normals,
    )
    return gaps, normals


@compiled(error_model="numpy")
def _cast(
    planes: Array,
    offsets: Array,
    ends: NDArray[np.int64],
    points: Array,
    direction: Array,
    back: float,
    gaps: Array,
    normals: Array,
) -> None:
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        begin = 0
        for end in ends:
            enter, leave, face = -np.inf, np.inf, -1
            for f in range(begin, end):
                a, b, c = planes[f, 0], planes[f, 1], planes[f, 2]
                room = offsets[f] - (a * x + b * y + c * z)
                speed = a * direction[0] + b * direction[1] + c * direction[2]
                if abs(speed) < 1e-12:
                    if room < 0:
                        leave = -np.inf
                elif speed < 0:
                    if room / speed > enter:
                        enter, face = room / speed, f
                elif room / speed < leave:
                    leave = room / speed
            begin = end
            if face >= 0 and enter <= leave and leave > back and enter < gaps[n]:
                gaps[n] = enter
                normals[n] = planes[face]


def step_vacuum(
    level: float, leak: float, pump_on: bool, time_step: float, config: SuctionConfig
) -> float:
    """The vacuum's level, 0..1, one step later.

    The pump's flow falls with the level and an orifice lets in its square root's worth:
    build_up_time dv/dt = (1 - v) - leak_ratio leak sqrt(v); a closed valve vents the
    cup: vent_time dv/dt = -v. Implicit Euler, so that any step is stable.

    Args:
        level: now.
        leak: share of the lip that is open, 0..1.
        pump_on: whether the valve joins cup and pump.
        time_step: s.
        config: the cup's.
    """
    if not pump_on:
        return level / (1 + time_step / config.vent_time)
    rate = time_step / config.build_up_time
    half_leak = rate * config.leak_ratio * leak / 2
    # (1 + rate) s^2 + 2 half_leak s - (level + rate) = 0 for s = sqrt(v)
    root = math.sqrt(half_leak**2 + (1 + rate) * (level + rate))
    return float(((root - half_leak) / (1 + rate)) ** 2)
