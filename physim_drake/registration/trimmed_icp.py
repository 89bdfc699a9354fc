# SPDX-License-Identifier: MIT
"""Aligns an object's distance field with observed points: scores and trimmed ICP.

All functions take many poses at once. The nearest surface point of an observed point
is read off the model's `DistanceField`, so no correspondence search is needed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np

from physim_drake.compiled import compiled
from physim_drake.poses import Array
from physim_drake.registration.distance_field import (
    DistanceField,
    FieldArrays,
    interpolate,
    lookup,
)


@dataclass(frozen=True)
class TrimmedIcpConfig:
    """How trimmed ICP weighs points (Chetverikov et al. 2002).

    Attributes:
        keep: share of the points that count, the nearest ones to the model.
        soft: whether the weights of those points fall with distance (Tukey's
            biweight). Otherwise all weights are the same.
        iterations: largest number of Gauss-Newton steps.
        cutoff: distance beyond which a point does not count, m.
        cos_normal: least cosine of the angle between observed and model normal.
        tolerance: step below which iteration stops, m and rad.
    """

    keep: float = 1.0
    soft: bool = True
    iterations: int = 20
    cutoff: float = 0.0075
    cos_normal: float = 0.3
    tolerance: float = 1e-4


_ConfigTuple = tuple[float, bool, int, float, float, float]
"""The configuration as compiled loops take it."""


def lcp_scores(
    field: DistanceField,
    X_SO: Array,
    points: Array,
    normals: Array,
    deltas: float | Sequence[float],
    cos_normal: float = 0.7,
) -> Array:
    """Largest-common-pointset scores: the share of points within delta of the model.

    Args:
        field: distance field of the model.
        X_SO: poses, (M, 4, 4).
        points: observed points p_S, (N, 3), m.
        normals: unit normals of the points, (N, 3). A point counts only if the model's
            normal agrees with it.
        deltas: distance, m, or several distances, (K,).
        cos_normal: least cosine of the angle between the normals.

    Returns:
        (M,) in 0..1, or (M, K) for several distances.
    """
    near = np.atleast_1d(np.asarray(deltas, dtype=float))
    scores = np.zeros((len(X_SO), len(near)))
    if len(points):
        _lcp(
            field.arrays,
            np.ascontiguousarray(X_SO),
            np.ascontiguousarray(points),
            np.ascontiguousarray(normals),
            near,
            cos_normal,
            scores,
        )
    return scores if np.ndim(deltas) else scores[:, 0]


def trimmed_icp(
    field: DistanceField,
    X_SO: Array,
    points: Array,
    normals: Array,
    config: TrimmedIcpConfig = TrimmedIcpConfig(),
) -> tuple[Array, Array]:
    """Moves each pose so that the nearest share of the points lies on the model.

    It is point-to-surface Gauss-Newton with the trimming of Chetverikov et al. 2002. A
    slight damping keeps directions that the points do not determine.

    Args:
        field: distance field of the model.
        X_SO: poses at the start, (M, 4, 4).
        points: observed points p_S, (N, 3), m.
        normals: unit normals of the points, (N, 3).
        config: rules for trimming and stopping.

    Returns:
        Refined poses (M, 4, 4), and the root mean square distance (M,), m, of the
        points that counted. It is infinite if fewer than six did.
    """
    poses = np.array(X_SO, dtype=float)
    residuals = np.full(len(poses), np.inf)
    if len(points) >= 6:
        _trimmed_icp(
            field.arrays,
            poses,
            np.ascontiguousarray(points),
            np.ascontiguousarray(normals),
            astuple(config),
            residuals,
        )
    return poses, residuals


@compiled(error_model="numpy")
def _lcp(
    field: FieldArrays,
    poses: Array,
    points: Array,
    normals: Array,
    deltas: Array,
    cos_normal: float,
    scores: Array,
) -> None:
    values, origin, inverse_spacing = field
    nx, ny, nz = values.shape
    # No distance differs by more than that from a point to its nearest node.
    farthest = deltas.max()
    far = np.float32(farthest + 0.87 / inverse_spacing)
    for m in range(len(poses)):
        X = poses[m]
        px, py, pz = X[0, 3], X[1, 3], X[2, 3]
        a00, a10, a20 = X[0, 0], X[1, 0], X[2, 0]
        a01, a11, a21 = X[0, 1], X[1, 1], X[2, 1]
        a02, a12, a22 = X[0, 2], X[1, 2], X[2, 2]
        for n in range(len(points)):
            dx, dy, dz = points[n, 0] - px, points[n, 1] - py, points[n, 2] - pz
            x = (a00 * dx + a10 * dy + a20 * dz - origin[0]) * inverse_spacing
            y = (a01 * dx + a11 * dy + a21 * dz - origin[1]) * inverse_spacing
            z = (a02 * dx + a12 * dy + a22 * dz - origin[2]) * inverse_spacing
            if not (0 <= x < nx - 1 and 0 <= y < ny - 1 and 0 <= z < nz - 1):
                continue
            i, j, k = int(x + 0.5), int(y + 0.5), int(z + 0.5)
            if abs(values[i, j, k]) > far:
                continue
            d, gx, gy, gz = interpolate(values, x, y, z)
            if abs(d) >= farthest:
                continue
            u, v, w = normals[n, 0], normals[n, 1], normals[n, 2]
            cosine = (
                gx * (a00 * u + a10 * v + a20 * w)
                + gy * (a01 * u + a11 * v + a21 * w)
                + gz * (a02 * u + a12 * v + a22 * w)
            )
            if cosine > cos_normal * math.sqrt(gx * gx + gy * gy + gz * gz):
                for e in range(len(deltas)):
                    if abs(d) < deltas[e]:
                        scores[m, e] += 1
        scores[m] /= len(points)


@compiled(error_model="numpy")
def _trimmed_icp(
    field: FieldArrays,
    poses: Array,
    points: Array,
    normals: Array,
    config: _ConfigTuple,
    residuals: Array,
) -> None:
    keep, soft, iterations, cutoff, cos_normal, tolerance = config
    count = len(points)
    centre = np.zeros(3)
    for n in range(count):
        centre += points[n] / count
    kept = max(6, int(keep * count))
    rows = np.empty((count, 7))  # rows of the Jacobian, and the distance
    magnitude, scratch = np.empty(count), np.empty(count)
    A, b = np.empty((6, 6)), np.empty(6)
    for m in range(len(poses)):
        X = poses[m]
        for _ in range(iterations):
            _linearise(
                field, X, points, normals, centre, cutoff, cos_normal, rows, magnitude
            )
            scratch[:] = magnitude
            threshold = max(min(cutoff, _smallest(scratch, kept - 1)), 1e-9)
            used, squares = _accumulate(rows, magnitude, threshold, soft, A, b)
            if used < 6:
                residuals[m] = np.inf
                break
            residuals[m] = math.sqrt(squares / used)
            for i in range(3):
                A[i, i] += 1e-5 * used
                A[i + 3, i + 3] += 1e-2 * used
            solve_positive(A, b)
            apply_step(X, b, centre)
            if np.abs(b).max() < tolerance:
                break


@compiled(error_model="numpy")
def _linearise(
    field: FieldArrays,
    X: Array,
    points: Array,
    normals: Array,
    centre: Array,
    cutoff: float,
    cos_normal: float,
    rows: Array,
    magnitude: Array,
) -> None:
    """Weighted distances of points, and their derivatives by the pose."""
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        dx, dy, dz = x - X[0, 3], y - X[1, 3], z - X[2, 3]
        d, ox, oy, oz = lookup(
            field,
            X[0, 0] * dx + X[1, 0] * dy + X[2, 0] * dz,
            X[0, 1] * dx + X[1, 1] * dy + X[2, 1] * dz,
            X[0, 2] * dx + X[1, 2] * dy + X[2, 2] * dz,
        )
        gx = X[0, 0] * ox + X[0, 1] * oy + X[0, 2] * oz
        gy = X[1, 0] * ox + X[1, 1] * oy + X[1, 2] * oz
        gz = X[2, 0] * ox + X[2, 1] * oy + X[2, 2] * oz
        length = math.sqrt(gx * gx + gy * gy + gz * gz) + 1e-9
        cosine = gx * normals[n, 0] + gy * normals[n, 1] + gz * normals[n, 2]
        magnitude[n] = abs(d)
        if not cosine > cos_normal * length:
            magnitude[n] += cutoff
        x, y, z = x - centre[0], y - centre[1], z - centre[2]
        rows[n, 0] = y * gz - z * gy
        rows[n, 1] = z * gx - x * gz
        rows[n, 2] = x * gy - y * gx
        rows[n, 3], rows[n, 4], rows[n, 5], rows[n, 6] = gx, gy, gz, d


@compiled(error_model="numpy")
def _accumulate(
    rows: Array, magnitude: Array, threshold: float, soft: bool, A: Array, b: Array
) -> tuple[int, float]:
    """Normal equations, number and sum of squares of the rows that count."""
    A[:], b[:] = 0.0, 0.0
    used, squares = 0, 0.0
    for n in range(len(rows)):
        if magnitude[n] > threshold:
            continue
        d = rows[n, 6]
        weight = (1 - (magnitude[n] / threshold) ** 2) ** 2 if soft else 1.0
        for i in range(6):
            weighted = weight * rows[n, i]
            b[i] += weighted * d
            for j in range(i + 1):
                A[i, j] += weighted * rows[n, j]
        used += 1
        squares += d * d
    return used, squares


@compiled(error_model="numpy")
def _smallest(values: Array, rank: int) -> float:
    """The value of this rank from below (Hoare's selection). It reorders `values`.

    In place of `np.partition`, which allocates: this runs in each step of each pose.
    """
    low, high = 0, len(values) - 1
    while low < high:
        pivot = values[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if rank <= j:
            high = j
        elif rank >= i:
            low = i
        else:
            break
    return float(values[rank])


@compiled(error_model="numpy")
def solve_positive(A: Array, b: Array) -> None:
    """Solves A x = b in place by Cholesky. It reads only the lower triangle of A.

    In place of `np.linalg.solve`, which allocates and asks LAPACK: A is 6 x 6.
    """
    size = len(b)
    for i in range(size):
        for j in range(i + 1):
            total = A[i, j]
            for k in range(j):
                total -= A[i, k] * A[j, k]
            if i == j:
                A[i, i] = math.sqrt(total)
            else:
                A[i, j] = total / A[j, j]
        for k in range(i):
            b[i] -= A[i, k] * b[k]
        b[i] /= A[i, i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            b[i] -= A[k, i] * b[k]
        b[i] /= A[i, i]


@compiled(error_model="numpy")
def apply_step(X: Array, step: Array, centre: Array) -> None:
    """Turns X_SO in place by `step[:3]` (rad) about `centre`, then shifts it."""
    angle = math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
    R = np.eye(3)
    if angle > 1e-12:
        a, b, c = step[0] / angle, step[1] / angle, step[2] / angle
        s, k = math.sin(angle), 1 - math.cos(angle)
        R[0, 0] += k * (a * a - 1)
        R[1, 1] += k * (b * b - 1)
        R[2, 2] += k * (c * c - 1)
        R[0, 1], R[1, 0] = k * a * b - s * c, k * a * b + s * c
        R[0, 2], R[2, 0] = k * a * c + s * b, k * a * c - s * b
        R[1, 2], R[2, 1] = k * b * c - s * a, k * b * c + s * a
    # As if the origin were the centre of the turn.
    for i in range(3):
        X[i, 3] -= centre[i]
    for j in range(4):
        x, y, z = X[0, j], X[1, j], X[2, j]
        for i in range(3):
            X[i, j] = R[i, 0] * x + R[i, 1] * y + R[i, 2] * z
    for i in range(3):
        X[i, 3] += centre[i] + step[3 + i]
