# SPDX-License-Identifier: MIT
"""All pairs of an object's surface points, to be found by length and normals.

Sorted once an object by their length, so that looking for the pairs of one length
costs what lies within the tolerance.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from physim_drake.compiled import compiled
from physim_drake.objects.model import ObjectModel
from physim_drake.poses import Array
from physim_drake.registration.registration_model import registration_model

Indices = NDArray[np.int64]
Points = NDArray[np.int32]


class PairArrays(NamedTuple):
    """A `PairIndex` as kernels take it; the attributes are those of the index."""

    points: Array
    lengths: Array
    angles: Array
    first: Points
    second: Points


class PairIndex:
    """All ordered pairs of model points, sorted by length, with their normals' angles.

    Attributes:
        points: p_O, (N, 3), m.
        normals: unit, (N, 3).
        lengths: lengths of the pairs, rising, (P,), m.
        first: index of the point each pair begins at, (P,).
        second: index of the point each pair ends at, (P,).
        angles: the three of `pair_angles` of each pair, (3, P), rad.

    Args:
        points: model points p_O, (N, 3), m.
        normals: unit normals at the points, (N, 3).
    """

    def __init__(self, points: Array, normals: Array) -> None:
        self.points = np.ascontiguousarray(points)
        self.normals = np.ascontiguousarray(normals)
        first, second = np.nonzero(~np.eye(len(points), dtype=bool))
        lengths = np.linalg.norm(points[second] - points[first], axis=1)
        order = np.argsort(lengths, kind="stable")
        order = order[lengths[order] > 1e-6]
        self.lengths = lengths[order]
        self.first: Points = first[order].astype(np.int32)
        self.second: Points = second[order].astype(np.int32)
        angles = pair_angles(
            points[self.first],
            normals[self.first],
            points[self.second],
            normals[self.second],
        )
        self.angles = np.ascontiguousarray(angles.T)

    @property
    def arrays(self) -> PairArrays:
        """What finding pairs takes, for kernels."""
        return PairArrays(
            self.points, self.lengths, self.angles, self.first, self.second
        )

    def find(
        self, length: float, angles: Array, delta: float, tolerance: float
    ) -> tuple[Points, Points]:
        """First and second points of the pairs of this length and these angles.

        Args:
            length: m.
            angles: the three of `pair_angles`, rad.
            delta: largest difference of lengths, m.
            tolerance: largest difference of each angle, rad.
        """
        found = find_pairs(self.lengths, self.angles, length, angles, delta, tolerance)
        return self.first[found], self.second[found]


@lru_cache(maxsize=256)
def pair_index(model: ObjectModel) -> PairIndex:
    """The pair index of an object; the last 256 are kept."""
    prepared = registration_model(model)
    return PairIndex(prepared.points, prepared.normals)


def pair_angles(p1: Array, n1: Array, p2: Array, n2: Array) -> Array:
    """Angles (..., 3) of both normals to the line between points, and to each other."""
    line = p2 - p1
    line = line / (np.linalg.norm(line, axis=-1, keepdims=True) + 1e-12)

    def angle(a: Array, b: Array) -> Array:
        cosine = np.einsum("...i,...i->...", a, b)
        return np.asarray(np.arccos(np.clip(cosine, -1, 1)))

    return np.stack([angle(n1, line), angle(n2, line), angle(n1, n2)], axis=-1)


@compiled()
def find_pairs(
    lengths: Array,
    angles: Array,
    length: float,
    wanted: Array,
    delta: float,
    tolerance: float,
) -> Indices:
    """Indices of the pairs that `PairIndex.find` describes, for other kernels."""
    low = np.searchsorted(lengths, length - delta)
    high = np.searchsorted(lengths, length + delta)
    found = np.empty(high - low, dtype=np.int64)
    count = 0
    for n in range(low, high):
        # Written without a branch: most pairs fail, in no order.
        found[count] = n
        count += (
            (abs(angles[0, n] - wanted[0]) < tolerance)
            & (abs(angles[1, n] - wanted[1]) < tolerance)
            & (abs(angles[2, n] - wanted[2]) < tolerance)
        )
    return found[:count]
