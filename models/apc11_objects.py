# SPDX-License-Identifier: MIT
"""The eleven objects of the paper: dimensions, collision pieces, symmetry, mass.

The objects and their extents are those of the 2016 Amazon Picking Challenge as
Mitash, Boularias and Bekris use them in "Improving 6D Pose Estimation of Objects in
Clutter via Physics-aware Monte Carlo Tree Search" (ICRA 2018). Shapes and prints are
our own. Profiles are lists of (y, radius) or (y, radius along x, radius along z) in
millimetres.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from physim_drake.models import apc11_box_prints as boxes
from physim_drake.models import apc11_round_prints as rounds
from physim_drake.models.apc11_drawing import Panel
from physim_drake.models.apc11_shapes import (
    Array,
    Band,
    Surface,
    arc,
    ball_corners,
    chamfered_box,
    convex_stack,
    disc_rings,
    displaced,
    ring_wedges,
    swept,
)

FRICTION = 0.8
_CHAMFER = 0.001  # m
_SEGMENTS = 96  # steps around a swept surface

# Half and quarter turns about x, y, z, as rotation matrices.
_X2, _Y2, _Z2 = (np.diag(d) for d in ([1.0, -1, -1], [-1.0, 1, -1], [-1.0, -1, 1]))
_X1 = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
_Y1 = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])


@dataclass(frozen=True)
class ObjectSpec:
    """All that is specified of one object.

    Attributes:
        object_id: number in the paper's table.
        name: name of the object.
        mass: mass, kg.
        extents: full lengths along x, y, z, m.
        surface: visual surface.
        pieces: corners of each convex collision piece, m.
        paint: function that draws the panels.
        turns: rotations that map the object onto itself, without the identity.
        axes: directions of continuous axes through the origin.
    """

    object_id: int
    name: str
    mass: float
    extents: tuple[float, float, float]
    surface: Surface
    pieces: Sequence[Array]
    paint: Callable[[Mapping[str, Panel]], None]
    turns: Sequence[Array] = ()
    axes: Sequence[tuple[int, int, int]] = ()


def all_objects() -> list[ObjectSpec]:
    """The eleven objects in the order of the table."""
    return [
        _box(1, "crayola_24_ct", 0.22, (0.022, 0.095, 0.071), boxes.crayons),
        _box(
            2,
            "expo_dry_erase_board_eraser",
            0.10,
            (0.055, 0.130, 0.035),
            boxes.eraser,
        ),
        _coffee_can(),
        _tape(),
        _glucose_bottle(),
        _box(6, "laugh_out_loud_joke_book", 0.15, (0.010, 0.178, 0.108), boxes.book),
        _box(
            7,
            "soft_white_lightbulb",
            0.14,
            (0.062, 0.120, 0.064),
            boxes.lightbulb,
            [_X2, _Y2, _Z2, _Y1, _Y1.T, _Y1 @ _X2, _Y1.T @ _X2],
        ),
        _box(
            8,
            "kleenex_tissue_box",
            0.20,
            (0.128, 0.110, 0.112),
            boxes.tissues,
            [_X2, _Y2, _Z2, _X1, _X1.T, _X1 @ _Y2, _X1.T @ _Y2],
        ),
        _box(9, "dove_beauty_bar", 0.25, (0.037, 0.065, 0.091), boxes.soap),
        _glue_bottle(),
        _baseball(),
    ]


def _box(
    object_id: int,
    name: str,
    mass: float,
    extents: tuple[float, float, float],
    paint: Callable[[Mapping[str, Panel]], None],
    turns: Sequence[Array] = (_X2, _Y2, _Z2),
) -> ObjectSpec:
    surface = chamfered_box(extents, _CHAMFER)
    pieces = [surface.vertices]
    return ObjectSpec(
        object_id, name, mass, extents, surface, pieces, paint, turns=turns
    )


def _coffee_can() -> ObjectSpec:
    """A plastic can. The lid's rim stands out by 1.5 mm, so that a flip is visible.

    The grips are 0.8 mm deep. They are visible in colour, but too shallow for a depth
    camera to break the continuous symmetry.
    """
    lid, body = 52.0, 50.5
    side = np.concatenate(
        [
            arc((-67.8, body), (-70, 48.3), 3)[::-1],
            disc_rings([(y, body) for y in np.linspace(-45, 54, 12)])[:, :2],
            [(54.0, lid - 0.5), (54.5, lid)],
            arc((68.2, lid), (70, lid - 1.8), 3),
        ]
    )
    surface = swept(
        [
            Band(
                "base",
                disc_rings([(-69.2, 0), (-69.2, 45), (-70, 46), (-70, 48.3)]),
                True,
            ),
            Band("side", disc_rings(side)),
            Band(
                "lid",
                disc_rings([(70, lid - 1.8), (70, 48), (69.3, 47), (69.3, 0)]),
                True,
            ),
        ],
        _SEGMENTS,
    )

    def grip(azimuth: Array, y: Array) -> Array:
        away = np.abs(np.abs(azimuth) - np.pi / 2) / np.radians(32)
        along = np.abs(y) / 0.040
        inside = (away < 1) & (along < 1)
        ripple = 0.7 + 0.3 * np.cos(2 * np.pi * y / 0.018)
        return np.where(inside, 0.0008 * np.cos(np.pi / 2 * away) * ripple, 0.0)

    return ObjectSpec(
        3,
        "folgers_classic_roast_coffee",
        0.45,
        (0.104, 0.140, 0.104),
        displaced(surface, grip),
        [
            convex_stack([(-70, 50.2), (54, 50.2)], 20),
            convex_stack([(54, 51.9), (69.7, 51.9)], 20),
        ],
        rounds.coffee,
        axes=[(0, 1, 0)],
    )


def _tape() -> ObjectSpec:
    outer, inner, half, edge = 48.0, 38.0, 24.5, 0.6
    top = disc_rings(
        [
            (half - edge, outer),
            (half, outer - edge),
            (half, inner + edge),
            (half - edge, inner),
        ]
    )
    surface = swept(
        [
            Band("outside", disc_rings([(edge - half, outer), (half - edge, outer)])),
            Band("top", top, True),
            Band("inside", disc_rings([(half - edge, inner), (edge - half, inner)])),
            Band("bottom", top[::-1] * [-1, 1, 1], True),
        ],
        _SEGMENTS,
    )
    return ObjectSpec(
        4,
        "scotch_duct_tape",
        0.30,
        (0.096, 0.049, 0.096),
        surface,
        ring_wedges(inner, outer, 2 * half, 24),
        rounds.tape,
        turns=[_X2],
        axes=[(0, 1, 0)],
    )


def _glucose_bottle() -> ObjectSpec:
    body, neck, cap = 35.0, 28.0, 30.5
    shoulder = arc((36, body), (46, neck), 8)
    side = np.concatenate(
        [
            arc((-68, body), (-70, body - 2), 3)[::-1],
            shoulder,
            [(49, neck), (49, cap - 0.4), (49.4, cap)],
            [(y, cap) for y in np.linspace(52, 66, 3)],
            arc((68, cap), (70, cap - 2), 3),
        ]
    )
    surface = swept(
        [
            Band(
                "base",
                disc_rings([(-69.3, 0), (-69.3, 28), (-70, 29), (-70, 33)]),
                True,
            ),
            Band("side", disc_rings(side)),
            Band("cap", disc_rings([(70, cap - 2), (70, 0)]), True),
        ],
        _SEGMENTS,
    )
    return ObjectSpec(
        5,
        "up_glucose_bottle",
        0.35,
        (0.070, 0.140, 0.070),
        displaced(surface, _ribs(0.049, 0.068)),
        [
            convex_stack([(-70, body), (36, body)], 20),
            convex_stack(shoulder[[0, 4, 8]] + [0, 0.2], 16),
            convex_stack([(46, neck), (49, neck)], 12),
            convex_stack([(49, cap - 0.2), (70, cap - 0.2)], 16),
        ],
        rounds.glucose,
        axes=[(0, 1, 0)],
    )


def _glue_bottle() -> ObjectSpec:
    """A flat bottle: elliptic body and shoulder, round cap, conical nozzle."""
    base, wide = (-72.5, 30.0, 13.0), (-70.5, 32.0, 15.0)
    shoulder = arc((14, 32.0, 15.0), (31, 11.0, 11.0), 9)
    side = np.concatenate(
        [
            arc(wide, base, 3)[::-1],
            shoulder,
            disc_rings(
                [(33, 11), (33, 13), (33.4, 13.4), (38, 13.4), (43, 13.4), (44, 12.8)]
            ),
            disc_rings([(45, 9.0), (46, 8.2), (54, 6.0), (64, 4.2), (70.5, 3.2)]),
            arc((70.5, 3.2, 3.2), (72.5, 1.6, 1.6), 3)[1:],
        ]
    )
    tip = [(72.5, 1.6), (72.5, 0)]
    surface = swept(
        [
            Band("base", np.array([(-72.5, 0, 0), base]), True),
            Band("side", side),
            Band("tip", disc_rings(tip), True),
        ],
        _SEGMENTS,
    )
    return ObjectSpec(
        10,
        "elmers_washable_no_run_school_glue",
        0.16,
        (0.064, 0.145, 0.030),
        displaced(surface, _ribs(0.033, 0.0435)),
        [
            convex_stack([(-72.5, 31.9, 14.9), (14, 31.9, 14.9)], 20),
            convex_stack(shoulder[[0, 3, 6]] + [0, 0.2, 0.2], 16),
            convex_stack(shoulder[[6, 9]] + [0, 0.2, 0.2], 16),
            convex_stack([(31, 11), (33, 11)], 10),
            convex_stack([(33, 13.2), (44.2, 13.2)], 12),
            convex_stack([(44.2, 8.7), (54, 6.0), (72.5, 2.6)], 8),
        ],
        rounds.glue,
        turns=[_Y2],
    )


def _baseball() -> ObjectSpec:
    radius = 35.0
    latitude = np.radians(np.linspace(-90, 90, 29))
    rings = np.stack([np.sin(latitude), np.cos(latitude).round(12)], axis=1) * radius
    surface = swept([Band("skin", disc_rings(rings))], 64)
    return ObjectSpec(
        11,
        "rawlings_baseball",
        0.15,
        (0.070, 0.070, 0.070),
        surface,
        [ball_corners(radius)],
        rounds.baseball,
        axes=[(1, 0, 0), (0, 1, 0), (0, 0, 1)],
    )


def _ribs(bottom: float, top: float) -> Callable[[Array, Array], Array]:
    """Ribs 0.5 mm deep along y on a cap between two heights, m."""

    def depth(azimuth: Array, y: Array) -> Array:
        wave = 0.5 - 0.5 * np.cos(_SEGMENTS / 2 * azimuth)
        on_cap = (y > bottom + 2e-4) & (y < top)
        return np.where(on_cap, 0.0005 * wave, 0.0)

    return depth
