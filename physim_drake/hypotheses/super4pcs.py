# SPDX-License-Identifier: MIT
"""Super4PCS: poses from congruent sets of four points (Mellado et al. 2014).

A base of four nearly coplanar points is drawn from the observed segment; sets of four
model points with the same two diagonals, crossing at the same ratios and the same
angle, are congruent to it, and each gives a rigid transform.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from physim_drake.compiled import compiled
from physim_drake.hypotheses.bases import draw_bases
from physim_drake.hypotheses.pairs import (
    Indices,
    PairArrays,
    PairIndex,
    Points,
    find_pairs,
)
from physim_drake.hypotheses.rigid_fit import fit_sets
from physim_drake.poses import Array

_BLOCK = 32  # bases drawn at a time


@dataclass(frozen=True)
class Super4PcsConfig:
    """Sizes and tolerances.

    Attributes:
        hypotheses: stops when this many poses were found.
        sets_per_base: at most this many of one base's congruent sets, drawn evenly.
        max_pairs: largest number of model pairs for one diagonal, drawn evenly.
        delta: greatest difference of distances that agree, m; the root mean square
            distance of a pose's four points is at most twice as much.
        max_normal_angle: greatest angle between normals that agree, rad.
        max_set_angle: greatest difference of the angles between diagonals, rad.
        max_bases: stops after trying this many bases.
    """

    hypotheses: int = 20_000
    sets_per_base: int = 250
    max_pairs: int = 1000
    delta: float = 0.005
    max_normal_angle: float = np.radians(30.0)
    max_set_angle: float = np.radians(10.0)
    max_bases: int = 3000


def super4pcs(
    index: PairIndex,
    points: Array,
    normals: Array,
    generator: np.random.Generator,
    config: Super4PcsConfig = Super4PcsConfig(),
) -> Array:
    """Poses of the model that put congruent sets of it on bases of the segment.

    Args:
        index: the model's pairs.
        points: the segment's p_S, (N, 3), m.
        normals: unit normals at the points, (N, 3).
        generator: draws bases.
        config: sizes and tolerances.

    Returns:
        X_SO, (M, 4, 4); empty if the segment has too few points or fits nowhere.
    """
    poses = np.zeros((config.hypotheses, 4, 4))
    if len(points) < 4:
        return poses[:0]
    points, normals = np.ascontiguousarray(points), np.ascontiguousarray(normals)
    count, tried = 0, 0
    reach = float(index.lengths[-1])
    while count < len(poses) and tried < config.max_bases:
        bases = draw_bases(points, reach, config.delta, _BLOCK, generator)
        tried += _BLOCK
        for corners, ratios, angle in zip(
            bases.corners, bases.ratios, bases.angles, strict=True
        ):
            p, n = points[corners], normals[corners]
            sets = congruent_sets(index, p, n, ratios, angle, config)
            count += fit_sets(
                p, n, index.points, index.normals, sets, 2 * config.delta, poses[count:]
            )
    return poses[:count]


def congruent_sets(
    index: PairIndex,
    points: Array,
    normals: Array,
    ratios: Array,
    angle: float,
    config: Super4PcsConfig,
) -> Points:
    """Model points congruent to a base.

    Args:
        index: the model's pairs.
        points: points of the base, (4, 3), m.
        normals: unit normals at the points, (4, 3).
        ratios: shares along its diagonals 0-1 and 2-3 at which they cross, (2,).
        angle: between its diagonals, rad.
        config: tolerances.

    Returns:
        indices of model points, (M, 4).
    """
    limits = _Limits(
        config.delta,
        config.max_normal_angle,
        np.cos(min(angle + config.max_set_angle, np.pi)),
        np.cos(max(angle - config.max_set_angle, 0.0)),
        config.max_pairs,
        config.sets_per_base,
    )
    sets: Points = _congruent_sets(index.arrays, points, normals, ratios, limits)
    return sets


class _Limits(NamedTuple):
    """What `Super4PcsConfig` means for one base, as kernels take it."""

    delta: float
    max_normal_angle: float
    cos_low: float
    cos_high: float
    max_pairs: int
    max_sets: int


@compiled(error_model="numpy")
def _congruent_sets(
    model: PairArrays, points: Array, normals: Array, ratios: Array, limits: _Limits
) -> Points:
    first, second, delta = model.first, model.second, limits.delta
    pairs = []
    for k in (0, 2):
        line = points[k + 1] - points[k]
        length = np.sqrt(np.square(line).sum())
        line /= length
        wanted = np.empty(3)
        wanted[0] = np.arccos(min(max((normals[k] * line).sum(), -1.0), 1.0))
        wanted[1] = np.arccos(min(max((normals[k + 1] * line).sum(), -1.0), 1.0))
        wanted[2] = np.arccos(min(max((normals[k] * normals[k + 1]).sum(), -1.0), 1.0))
        found = find_pairs(
            model.lengths,
            model.angles,
            length,
            wanted,
            delta,
            limits.max_normal_angle,
        )
        pairs.append(_thinned(found, limits.max_pairs))
    rows, columns = _meeting(
        _crossings(model.points, first[pairs[0]], second[pairs[0]], ratios[0]),
        _crossings(model.points, first[pairs[1]], second[pairs[1]], ratios[1]),
        delta,
        limits.cos_low,
        limits.cos_high,
    )
    kept = _thinned(np.arange(len(rows)), limits.max_sets)
    sets = np.empty((len(kept), 4), dtype=np.int32)
    for n in range(len(kept)):
        a, b = pairs[0][rows[kept[n]]], pairs[1][columns[kept[n]]]
        sets[n, 0], sets[n, 1] = first[a], second[a]
        sets[n, 2], sets[n, 3] = first[b], second[b]
    return sets


@compiled()
def _thinned(indices: Indices, count: int) -> Indices:
    """At most `count` of the indices, evenly."""
    if len(indices) <= count:
        return indices
    return indices[np.arange(count) * len(indices) // count]


@compiled(error_model="numpy")
def _crossings(model: Array, first: Points, second: Points, ratio: float) -> Array:
    """The point at a ratio of each pair, and the pair's direction: (N, 6)."""
    result = np.empty((len(first), 6))
    for n in range(len(first)):
        p, q = model[first[n]], model[second[n]]
        dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        length = np.sqrt(dx * dx + dy * dy + dz * dz)
        result[n, 0] = p[0] + ratio * dx
        result[n, 1] = p[1] + ratio * dy
        result[n, 2] = p[2] + ratio * dz
        result[n, 3], result[n, 4] = dx / length, dy / length
        result[n, 5] = dz / length
    return result


@compiled(error_model="numpy")
def _meeting(
    A: Array, B: Array, delta: float, cos_low: float, cos_high: float
) -> tuple[Indices, Indices]:
    """Rows of A and B whose points meet and whose directions are at the right angle."""
    rows, columns = np.empty(1024, dtype=np.int64), np.empty(1024, dtype=np.int64)
    count = 0
    if len(A) == 0 or len(B) == 0:
        return rows[:0], columns[:0]
    low, shape, starts, order = _cells(B, delta)
    for i in range(len(A)):
        x, y, z = A[i, 0], A[i, 1], A[i, 2]
        cx = math.floor((x - low[0]) / delta)
        cy = math.floor((y - low[1]) / delta)
        cz = math.floor((z - low[2]) / delta)
        if cz < -1 or cz > shape[2]:
            continue
        near, far = max(cz - 1, 0), min(cz + 1, shape[2] - 1)
        for nx in range(max(cx - 1, 0), min(cx + 2, shape[0])):
            for ny in range(max(cy - 1, 0), min(cy + 2, shape[1])):
                # Cells one after the other in z hold points one after the other.
                column = (nx * shape[1] + ny) * shape[2]
                for n in range(starts[column + near], starts[column + far + 1]):
                    j = order[n]
                    dx, dy, dz = B[j, 0] - x, B[j, 1] - y, B[j, 2] - z
                    if dx * dx + dy * dy + dz * dz >= delta * delta:
                        continue
                    cosine = A[i, 3] * B[j, 3] + A[i, 4] * B[j, 4] + A[i, 5] * B[j, 5]
                    if cos_low <= cosine <= cos_high:
                        if count == len(rows):
                            rows = np.concatenate((rows, np.empty_like(rows)))
                            columns = np.concatenate((columns, np.empty_like(columns)))
                        rows[count], columns[count] = i, j
                        count += 1
    return rows[:count], columns[:count]


@compiled(error_model="numpy")
def _cells(points: Array, size: float) -> tuple[Array, Points, Points, Points]:
    """Sorts points, the first three columns of (N, ...), into cubes.

    Returns:
        the corner of the first cube, how many there are along each axis, and, for all
        cubes in order, where the points of each begin in the last array.
    """
    low, shape = np.empty(3), np.empty(3, dtype=np.int32)
    for x in range(3):
        low[x] = points[:, x].min()
        shape[x] = int((points[:, x].max() - low[x]) / size) + 1
    cells = np.empty(len(points), dtype=np.int32)
    starts = np.zeros(shape[0] * shape[1] * shape[2] + 1, dtype=np.int32)
    for n in range(len(points)):
        x = int((points[n, 0] - low[0]) / size)
        y = int((points[n, 1] - low[1]) / size)
        z = int((points[n, 2] - low[2]) / size)
        cells[n] = (x * shape[1] + y) * shape[2] + z
        starts[cells[n] + 1] += 1
    starts = np.cumsum(starts).astype(np.int32)
    order = np.empty(len(points), dtype=np.int32)
    filled = starts.copy()
    for n in range(len(points)):
        order[filled[cells[n]]] = n
        filled[cells[n]] += 1
    return low, shape, starts, order
