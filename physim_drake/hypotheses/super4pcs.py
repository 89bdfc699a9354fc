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
from numpy.typing import NDArray
from scipy.spatial import cKDTree

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
    max_pairs: int = 1000
    delta: float = 0.005
    max_normal_angle: float = np.radians(30.0)
    max_set_angle: float = np.radians(10.0)
    max_bases: int = 400


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

    def find(self, length: float, angles: Array, config: Super4PcsConfig) -> Indices:
        """Indices of pairs of this length (m) with these three angles (rad)."""
        low, high = np.searchsorted(
            self.lengths, (length - config.delta, length + config.delta)
        )
        close = np.abs(self._angles[low:high] - angles).max(axis=1)
        return np.asarray(low + np.flatnonzero(close < config.max_normal_angle))


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
    found: list[Array] = []
    total = 0
    if len(points) < 4:
        return np.zeros((0, 4, 4))
    reach = float(index.lengths[-1])
    for _ in range(config.max_bases):
        base = _draw_base(points, normals, reach, generator, config)
        if base is None:
            continue
        sets = _congruent_sets(index, base, generator, config)
        if len(sets) == 0:
            continue
        poses = _fit_sets(index, base, sets, config)
        found.append(poses)
        total += len(poses)
        if total >= config.hypotheses:
            break
    return np.concatenate(found)[: config.hypotheses] if found else np.zeros((0, 4, 4))


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


def _congruent_sets(
    index: PairIndex,
    base: _Base,
    generator: np.random.Generator,
    config: Super4PcsConfig,
) -> Indices:
    """Model points (M, 4) congruent to the base."""
    ends = []
    for k in (0, 2):
        p, n = base.points[k : k + 2], base.normals[k : k + 2]
        found = index.find(
            float(np.linalg.norm(p[1] - p[0])),
            pair_angles(p[0], n[0], p[1], n[1]),
            config,
        )
        if len(found) > config.max_pairs:
            found = np.sort(generator.choice(found, config.max_pairs, replace=False))
        if len(found) == 0:
            return np.zeros((0, 4), dtype=np.int64)
        ends.append(np.stack([index.first[found], index.second[found]], axis=1))
    crossings = [
        index.points[e[:, 0]] + ratio * (index.points[e[:, 1]] - index.points[e[:, 0]])
        for e, ratio in zip(ends, base.ratios, strict=True)
    ]
    matches = cKDTree(crossings[0]).sparse_distance_matrix(
        cKDTree(crossings[1]), config.delta, output_type="coo_matrix"
    )
    rows, columns = np.asarray(matches.row), np.asarray(matches.col)
    order = np.lexsort((columns, rows))
    sets = np.concatenate([ends[0][rows[order]], ends[1][columns[order]]], axis=1)
    line = index.points[sets[:, 1]] - index.points[sets[:, 0]]
    cross = index.points[sets[:, 3]] - index.points[sets[:, 2]]
    cosines = np.einsum("ni,ni->n", line, cross) / (
        np.linalg.norm(line, axis=1) * np.linalg.norm(cross, axis=1)
    )
    angles = np.arccos(np.clip(cosines, -1, 1))
    sets = sets[np.abs(angles - base.angle) < config.max_set_angle]
    if len(sets) > config.sets_per_base:
        keep = generator.choice(len(sets), config.sets_per_base, replace=False)
        sets = sets[np.sort(keep)]
    return np.asarray(sets)


def _fit_sets(
    index: PairIndex, base: _Base, sets: Indices, config: Super4PcsConfig
) -> Array:
    """Least-squares poses X_SO (M, 4, 4) from points and normals; poor fits go."""
    model = index.points[sets]
    centre_S, centres_O = base.points.mean(axis=0), model.mean(axis=1)
    spread = np.linalg.norm(base.points - centre_S, axis=1).mean()
    weight = 0.3 * spread**2
    H = np.einsum("ki,nkj->nij", base.points - centre_S, model - centres_O[:, None])
    H = H + weight * np.einsum("ki,nkj->nij", base.normals, index.normals[sets])
    R = nearest_rotation(H)
    poses = np.tile(np.eye(4), (len(sets), 1, 1))
    poses[:, :3, :3] = R
    poses[:, :3, 3] = centre_S - np.einsum("nij,nj->ni", R, centres_O)
    residual = np.einsum("nij,nkj->nki", R, model) + poses[:, None, :3, 3] - base.points
    rms = np.sqrt((residual**2).sum(axis=2).mean(axis=1))
    return np.asarray(poses[rms < 2 * config.delta])
