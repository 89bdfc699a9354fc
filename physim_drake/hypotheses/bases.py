# SPDX-License-Identifier: MIT
"""Bases of Super4PCS: four nearly coplanar points of a segment, drawn wide.

The diagonals 0-1 and 2-3 of a base nearly cross. The ratios at which they do, and the
angle between them, do not change with the pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physim_drake.compiled import compiled
from physim_drake.poses import Array

Indices = NDArray[np.int64]

_TRIES = 60
_OFF_ENDS = 0.05  # of a diagonal: it is not crossed nearer to its ends


@dataclass(frozen=True)
class Bases:
    """Many bases of one segment.

    Attributes:
        corners: indices of the segment's points, (B, 4).
        ratios: shares along 0-1 and 2-3 at which the diagonals cross, (B, 2).
        angles: between the diagonals, (B,), rad.
    """

    corners: Indices
    ratios: Array
    angles: Array


def draw_bases(
    points: Array, reach: float, gap: float, count: int, generator: np.random.Generator
) -> Bases:
    """Draws bases: the first diagonal at random, the second the widest of 60.

    Args:
        points: the segment's, (N, 3), m.
        reach: no diagonal is longer, m.
        gap: the diagonals pass each other at most this far apart, m.
        count: number of tries.
        generator: source of the random choices.

    Returns:
        at most `count` bases; fewer if no second diagonal of a first one is good.
    """
    first = generator.integers(len(points), size=count)
    partner = generator.random(count)
    others = generator.integers(len(points), size=(count, _TRIES, 2))
    corners = np.empty((count, 4), dtype=np.int64)
    ratios, angles = np.empty((count, 2)), np.empty(count)
    good = _draw(points, reach, gap, first, partner, others, corners, ratios, angles)
    return Bases(corners[good], ratios[good], angles[good])


@compiled(error_model="numpy")
def _draw(
    points: Array,
    reach: float,
    gap: float,
    first: Indices,
    partner: Array,
    others: Indices,
    corners: Indices,
    ratios: Array,
    angles: Array,
) -> NDArray[np.bool_]:
    """Fills the last three arguments; says which rows of them hold a base."""
    good = np.zeros(len(first), dtype=np.bool_)
    distances = np.empty(len(points))
    for b in range(len(first)):
        i = first[b]
        for n in range(len(points)):
            distances[n] = np.sqrt(np.square(points[n] - points[i]).sum())
        limit = min(reach, distances.max())
        partners = np.flatnonzero((distances > 0.4 * limit) & (distances <= limit))
        if len(partners) == 0:
            continue
        j = partners[int(partner[b] * len(partners))]
        widest = 0.0
        for k, m in others[b]:
            s, t, length, angle, apart = _crossing(points, i, j, k, m)
            inside = _OFF_ENDS < s < 1 - _OFF_ENDS and _OFF_ENDS < t < 1 - _OFF_ENDS
            width = np.sin(angle) * length
            long_enough = 0.25 * limit < length < reach
            if inside and apart < gap and long_enough and width > widest:
                widest = width
                corners[b, 0], corners[b, 1] = i, j
                corners[b, 2], corners[b, 3] = k, m
                ratios[b, 0], ratios[b, 1] = s, t
                angles[b] = angle
                good[b] = True
    return good


@compiled(error_model="numpy")
def _crossing(
    points: Array, i: int, j: int, k: int, m: int
) -> tuple[float, float, float, float, float]:
    """Where the lines i-j and k-m are nearest, and how near.

    Returns:
        their ratios there, the length of k-m, the angle between the lines, and the gap.
    """
    a = b = c = d = e = 0.0
    for x in range(3):
        line = points[j, x] - points[i, x]
        cross = points[m, x] - points[k, x]
        w = points[i, x] - points[k, x]
        a += line * line
        b += line * cross
        c += cross * cross
        d += w * line
        e += cross * w
    denominator = a * c - b * b
    if denominator <= 1e-12 * a * c:  # parallel, or no line
        return np.nan, np.nan, 0.0, 0.0, np.inf
    s, t = (b * e - c * d) / denominator, (a * e - b * d) / denominator
    apart = 0.0
    for x in range(3):
        on_line = points[i, x] + s * (points[j, x] - points[i, x])
        on_cross = points[k, x] + t * (points[m, x] - points[k, x])
        apart += (on_line - on_cross) ** 2
    cosine = min(max(b / np.sqrt(a * c), -1.0), 1.0)
    return s, t, np.sqrt(c), np.arccos(cosine), np.sqrt(apart)
