# SPDX-License-Identifier: MIT
"""Super4PCS: poses from congruent sets of four points (Mellado et al. 2014).

A base of four nearly coplanar points is drawn from the observed segment; sets of four
model points with the same two diagonals, crossing at the same ratios and the same
angle, are congruent to it, and each gives a rigid transform. Pairs of model points
are indexed once an object by their length and normals, so that extracting the pairs
of a base costs what it returns.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from physim_drake.objects import ObjectModel
from physim_drake.poses import Array, nearest_rotation
from physim_drake.registration_model import registration_model

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Super4PcsConfig:
    """Sizes and tolerances.

    Attributes:
        hypotheses: stops when this many poses were found.
        sets_per_base: at most this many of one base's congruent sets, drawn evenly.
        max_pairs: at most this many model pairs for one diagonal, drawn evenly.
        delta: how well distances must agree, m.
        max_normal_angle: how well normals must agree, rad.
        max_set_angle: how well the angle between the diagonals must agree, rad.
        max_bases: stops after this many bases.
    """

    hypotheses: int = 20_000
    sets_per_base: int = 250
    max_pairs: int = 600
    delta: float = 0.005
    max_normal_angle: float = np.radians(30.0)
    max_set_angle: float = np.radians(10.0)
    max_bases: int = 700


class PairIndex:
    """All ordered pairs of model points, sorted by length, with their normals' angles.

    Args:
        points: p_O, (N, 3), m.
        normals: unit, (N, 3).
    """

    def __init__(self, points: Array, normals: Array) -> None:
        self.points, self.normals = points, normals
        first, second = np.nonzero(~np.eye(len(points), dtype=bool))
        lengths = np.linalg.norm(points[second] - points[first], axis=1)
        order = np.argsort(lengths, kind="stable")
        order = order[lengths[order] > 1e-6]
        self.lengths = lengths[order]
        self.first, self.second = first[order], second[order]
        self._angles = pair_angles(
            points[self.first],
            normals[self.first],
            points[self.second],
            normals[self.second],
        )

    def find(
        self, length: float, angles: Array, config: Super4PcsConfig
    ) -> tuple[Indices, Indices]:
        """First and second points of the pairs of this length and these angles.

        Args:
            length: m.
            angles: the three of `pair_angles`, rad.
            config: tolerances, and how many pairs to return at most.
        """
        low, high = np.searchsorted(
            self.lengths, (length - config.delta, length + config.delta)
        )
        found = low + _close_rows(
            self._angles[low:high], angles, config.max_normal_angle
        )
        found = _thinned(found, config.max_pairs)
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


@dataclass(frozen=True)
class _Base:
    """Four points whose diagonals 0-1 and 2-3 nearly cross, at the given ratios."""

    points: Array
    normals: Array
    ratios: tuple[float, float]
    angle: float


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
        normals: its unit normals, (N, 3).
        generator: draws bases, and sets where there are too many.
        config: sizes and tolerances.

    Returns:
        X_SO, (M, 4, 4); empty where the segment has too few points or fits nowhere.
    """
    if len(points) < 4:
        return np.zeros((0, 4, 4))
    bases: list[_Base] = []
    sets: list[Indices] = []
    total = 0
    reach = float(index.lengths[-1])
    for _ in range(config.max_bases):
        base = _draw_base(points, normals, reach, generator, config)
        if base is None:
            continue
        congruent = _congruent_sets(index, base, config)
        if len(congruent):
            bases.append(base)
            sets.append(congruent)
            total += len(congruent)
        # A few fits are poor and go, so a few more sets than poses.
        if total >= 1.2 * config.hypotheses:
            break
    if not sets:
        return np.zeros((0, 4, 4))
    return _fit_sets(index, bases, sets, config)[: config.hypotheses]


def _draw_base(
    points: Array,
    normals: Array,
    reach: float,
    generator: np.random.Generator,
    config: Super4PcsConfig,
    tries: int = 60,
) -> _Base | None:
    """Draws a wide base; among many random fourth points the widest good one."""
    i = int(generator.integers(len(points)))
    offsets = points - points[i]
    distances = np.linalg.norm(offsets, axis=1)
    limit = min(reach, float(distances.max()))
    partners = np.flatnonzero((distances > 0.4 * limit) & (distances <= limit))
    if len(partners) == 0:
        return None
    j = int(generator.choice(partners))
    line = points[j] - points[i]
    others = generator.integers(len(points), size=(tries, 2))
    start, end = points[others[:, 0]], points[others[:, 1]]
    # Closest points of the lines i-j and k-l: solve for their ratios.
    cross = end - start
    a, b, c = (
        line @ line,
        cross @ line,
        np.einsum("ni,ni->n", cross, cross),
    )
    w = points[i] - start
    d, e = w @ line, np.einsum("ni,ni->n", cross, w)
    denominator = a * c - b * b
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (b * e - c * d) / denominator
        t = (a * e - b * d) / denominator
        gap = np.linalg.norm(w + s[:, None] * line - t[:, None] * cross, axis=1)
        sine = np.sqrt(np.maximum(denominator, 0) / (a * c))
    good = (
        (gap < config.delta)
        & (s > 0.05)
        & (s < 0.95)
        & (t > 0.05)
        & (t < 0.95)
        & (np.sqrt(c) < reach)
        & (np.sqrt(c) > 0.25 * limit)
    )
    if not good.any():
        return None
    width = np.where(good, sine * np.sqrt(c), -1.0)
    best = int(width.argmax())
    chosen = np.array([i, j, *others[best]])
    cosine = line @ cross[best] / np.sqrt(a * c[best])
    return _Base(
        points[chosen],
        normals[chosen],
        (float(s[best]), float(t[best])),
        float(np.arccos(np.clip(cosine, -1, 1))),
    )


def _congruent_sets(index: PairIndex, base: _Base, config: Super4PcsConfig) -> Indices:
    """Model points (M, 4) congruent to the base."""
    ends: list[Indices] = []
    for k in (0, 2):
        p, n = base.points[k : k + 2], base.normals[k : k + 2]
        length = float(np.linalg.norm(p[1] - p[0]))
        ends += index.find(length, pair_angles(p[0], n[0], p[1], n[1]), config)
    if len(ends[0]) == 0 or len(ends[2]) == 0:
        return np.zeros((0, 4), dtype=np.int64)
    crossings, lines = [], []
    for k, ratio in zip((0, 2), base.ratios, strict=True):
        start, line = index.points[ends[k]], index.points[ends[k + 1]]
        line = line - start
        crossings.append(start + ratio * line)
        lines.append(line / np.linalg.norm(line, axis=1, keepdims=True))
    # Swept along the longest axis of the crossings.
    axis = int(np.ptp(crossings[0], axis=0).argmax())
    crossings = [np.roll(c, -axis, axis=1) for c in crossings]
    orders = [np.argsort(c[:, 0], kind="stable") for c in crossings]
    rows, columns = _matches(
        crossings[0][orders[0]],
        crossings[1][orders[1]],
        lines[0][orders[0]],
        lines[1][orders[1]],
        config.delta,
        np.cos(base.angle + config.max_set_angle)
        if base.angle + config.max_set_angle < np.pi
        else -1.0,
        np.cos(max(base.angle - config.max_set_angle, 0.0)),
    )
    kept = _thinned(np.arange(len(rows)), config.sets_per_base)
    first, second = orders[0][rows[kept]], orders[1][columns[kept]]
    return np.stack(
        [ends[0][first], ends[1][first], ends[2][second], ends[3][second]], axis=1
    )


def _thinned(indices: Indices, count: int) -> Indices:
    """At most `count` of the indices, evenly."""
    if len(indices) <= count:
        return indices
    return indices[np.arange(count) * len(indices) // count]


@njit(cache=True, nogil=True)
def _close_rows(rows: Array, wanted: Array, tolerance: float) -> Indices:
    """Indices of the rows (N, 3) whose every entry is near the wanted one."""
    found = np.empty(len(rows), dtype=np.int64)
    count = 0
    for n in range(len(rows)):
        if (
            abs(rows[n, 0] - wanted[0]) < tolerance
            and abs(rows[n, 1] - wanted[1]) < tolerance
            and abs(rows[n, 2] - wanted[2]) < tolerance
        ):
            found[count] = n
            count += 1
    return found[:count]


@njit(cache=True, nogil=True)
def _matches(
    A: Array,
    B: Array,
    lines_A: Array,
    lines_B: Array,
    delta: float,
    cos_low: float,
    cos_high: float,
) -> tuple[Indices, Indices]:
    """Pairs of points of A and B, both sorted by x, that meet at the right angle."""
    rows = np.empty(1024, dtype=np.int64)
    columns = np.empty(1024, dtype=np.int64)
    count, begin = 0, 0
    for i in range(len(A)):
        while begin < len(B) and B[begin, 0] < A[i, 0] - delta:
            begin += 1
        j = begin
        while j < len(B) and B[j, 0] <= A[i, 0] + delta:
            dy, dz = B[j, 1] - A[i, 1], B[j, 2] - A[i, 2]
            dx = B[j, 0] - A[i, 0]
            if dx * dx + dy * dy + dz * dz < delta * delta:
                cosine = (
                    lines_A[i, 0] * lines_B[j, 0]
                    + lines_A[i, 1] * lines_B[j, 1]
                    + lines_A[i, 2] * lines_B[j, 2]
                )
                if cos_low <= cosine <= cos_high:
                    if count == len(rows):
                        rows = np.concatenate((rows, np.empty_like(rows)))
                        columns = np.concatenate((columns, np.empty_like(columns)))
                    rows[count], columns[count] = i, j
                    count += 1
            j += 1
    return rows[:count], columns[:count]


def _fit_sets(
    index: PairIndex,
    bases: list[_Base],
    sets: list[Indices],
    config: Super4PcsConfig,
) -> Array:
    """Least-squares poses X_SO (M, 4, 4) from points and normals; poor fits go."""
    counts = [len(s) for s in sets]
    points = np.repeat(np.stack([b.points for b in bases]), counts, axis=0)
    normals = np.repeat(np.stack([b.normals for b in bases]), counts, axis=0)
    chosen = np.concatenate(sets)
    model = index.points[chosen]
    centres_S, centres_O = points.mean(axis=1), model.mean(axis=1)
    arms = points - centres_S[:, None]
    weight = 0.3 * (arms**2).sum(axis=2).mean(axis=1)
    H = np.swapaxes(arms, 1, 2) @ (model - centres_O[:, None])
    H += weight[:, None, None] * (np.swapaxes(normals, 1, 2) @ index.normals[chosen])
    R = nearest_rotation(H)
    poses = np.tile(np.eye(4), (len(chosen), 1, 1))
    poses[:, :3, :3] = R
    poses[:, :3, 3] = centres_S - np.einsum("nij,nj->ni", R, centres_O)
    residual = model @ np.swapaxes(R, 1, 2) + poses[:, None, :3, 3] - points
    rms = np.sqrt((residual**2).sum(axis=2).mean(axis=1))
    return np.asarray(poses[rms < 2 * config.delta])
