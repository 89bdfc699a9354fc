# SPDX-License-Identifier: MIT
"""Aligning an object's distance field to observed points: scores and trimmed ICP.

All functions take many poses at once. The nearest surface point of an observed point
is read off the model's `DistanceField`, so no correspondence search is needed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from physim_drake.distance_field import DistanceField, Grid, lookup
from physim_drake.poses import Array


@dataclass(frozen=True)
class TrimmedIcpConfig:
    """How trimmed ICP weighs points (Chetverikov et al. 2002).

    Attributes:
        keep: share of the points that count, those nearest to the model.
        iterations: at most this many Gauss-Newton steps.
        cutoff: points farther than this never count, m.
        cos_normal: least cosine between observed and model normal of a point.
        tolerance: stops when a step is smaller, in m and rad.
    """

    keep: float = 0.8
    iterations: int = 20
    cutoff: float = 0.02
    cos_normal: float = 0.3
    tolerance: float = 1e-4


def lcp_scores(
    field: DistanceField,
    X_SO: Array,
    points: Array,
    normals: Array,
    delta: float,
    cos_normal: float = 0.7,
) -> Array:
    """Largest-common-pointset scores: the share of points within `delta` of the model.

    Args:
        field: the model's distance field.
        X_SO: poses, (M, 4, 4).
        points: observed p_S, (N, 3), m.
        normals: their unit normals, (N, 3); a point counts only where the model's
            agrees.
        delta: distance, m.
        cos_normal: least cosine of the angle between the normals.

    Returns:
        (M,) in 0..1.
    """
    scores = np.zeros(len(X_SO))
    if len(points):
        _lcp(
            field.values,
            field.origin,
            1 / field.spacing,
            np.ascontiguousarray(X_SO),
            np.ascontiguousarray(points),
            np.ascontiguousarray(normals),
            delta,
            cos_normal,
            scores,
        )
    return scores


def trimmed_icp(
    field: DistanceField,
    X_SO: Array,
    points: Array,
    normals: Array,
    config: TrimmedIcpConfig = TrimmedIcpConfig(),
) -> tuple[Array, Array]:
    """Moves each pose so that the nearest share of the points lies on the model.

    Point-to-surface Gauss-Newton with the trimming of Chetverikov et al. 2002 and a
    slight damping, which keeps directions that the points do not determine.

    Args:
        field: the model's distance field.
        X_SO: starting poses, (M, 4, 4).
        points: observed p_S, (N, 3), m.
        normals: their unit normals, (N, 3).
        config: trimming and stopping.

    Returns:
        Refined poses (M, 4, 4), and the root mean square distance (M,), m, of the
        points that counted (infinite where fewer than six did).
    """
    poses = np.array(X_SO, dtype=float)
    residuals = np.full(len(poses), np.inf)
    if len(points) >= 6:
        _trimmed_icp(
            field.values,
            field.origin,
            1 / field.spacing,
            poses,
            np.ascontiguousarray(points),
            np.ascontiguousarray(normals),
            config.keep,
            config.iterations,
            config.cutoff,
            config.cos_normal,
            config.tolerance,
            residuals,
        )
    return poses, residuals


@njit(cache=True, nogil=True, error_model="numpy")
def _distance_in_frame(
    values: Grid, origin: Array, inverse_spacing: float, X: Array, p: Array, out: Array
) -> float:
    """Distance of p_S to the model at X_SO; writes the gradient in S to `out`."""
    dx, dy, dz = p[0] - X[0, 3], p[1] - X[1, 3], p[2] - X[2, 3]
    x = X[0, 0] * dx + X[1, 0] * dy + X[2, 0] * dz
    y = X[0, 1] * dx + X[1, 1] * dy + X[2, 1] * dz
    z = X[0, 2] * dx + X[1, 2] * dy + X[2, 2] * dz
    d: float
    d, gx, gy, gz = lookup(values, origin, inverse_spacing, x, y, z)
    out[0] = X[0, 0] * gx + X[0, 1] * gy + X[0, 2] * gz
    out[1] = X[1, 0] * gx + X[1, 1] * gy + X[1, 2] * gz
    out[2] = X[2, 0] * gx + X[2, 1] * gy + X[2, 2] * gz
    return d


@njit(cache=True, nogil=True, error_model="numpy")
def _lcp(
    values: Grid,
    origin: Array,
    inverse_spacing: float,
    poses: Array,
    points: Array,
    normals: Array,
    delta: float,
    cos_normal: float,
    scores: Array,
) -> None:
    g = np.empty(3)
    R = np.empty((3, 3))
    nx, ny, nz = values.shape
    # No distance changes by more than the way from a point to its nearest node.
    far = delta + 0.87 / inverse_spacing
    for m in range(len(poses)):
        X = poses[m]
        R[:] = X[:3, :3] * inverse_spacing
        ox, oy, oz = origin * inverse_spacing - 0.5
        hits = 0
        for n in range(len(points)):
            dx = points[n, 0] - X[0, 3]
            dy = points[n, 1] - X[1, 3]
            dz = points[n, 2] - X[2, 3]
            x = R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz - ox
            y = R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz - oy
            z = R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz - oz
            if not (0 <= x < nx and 0 <= y < ny and 0 <= z < nz):
                continue
            if abs(values[int(x), int(y), int(z)]) > far:
                continue
            d = _distance_in_frame(values, origin, inverse_spacing, X, points[n], g)
            if abs(d) < delta:
                length = math.sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2])
                cosine = (
                    g[0] * normals[n, 0] + g[1] * normals[n, 1] + g[2] * normals[n, 2]
                )
                if cosine > cos_normal * length:
                    hits += 1
        scores[m] = hits / len(points)


@njit(cache=True, nogil=True, error_model="numpy")
def _trimmed_icp(
    values: Grid,
    origin: Array,
    inverse_spacing: float,
    poses: Array,
    points: Array,
    normals: Array,
    keep: float,
    iterations: int,
    cutoff: float,
    cos_normal: float,
    tolerance: float,
    residuals: Array,
) -> None:
    count = len(points)
    centre = np.zeros(3)
    for n in range(count):
        centre += points[n] / count
    kept = max(6, int(keep * count))
    gradients = np.empty((count, 3))
    distances = np.empty(count)
    magnitude = np.empty(count)
    J = np.empty(6)
    for m in range(len(poses)):
        X = poses[m]
        for _ in range(iterations):
            for n in range(count):
                g = gradients[n]
                d = _distance_in_frame(values, origin, inverse_spacing, X, points[n], g)
                length = math.sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]) + 1e-9
                cosine = (
                    g[0] * normals[n, 0] + g[1] * normals[n, 1] + g[2] * normals[n, 2]
                )
                distances[n] = d
                agree = cosine > cos_normal * length
                magnitude[n] = abs(d) if agree else abs(d) + cutoff
            threshold = min(cutoff, np.partition(magnitude, kept - 1)[kept - 1])
            A = np.zeros((6, 6))
            b = np.zeros(6)
            used = 0
            squares = 0.0
            for n in range(count):
                if magnitude[n] > threshold:
                    continue
                g = gradients[n]
                x, y, z = points[n] - centre
                J[0] = y * g[2] - z * g[1]
                J[1] = z * g[0] - x * g[2]
                J[2] = x * g[1] - y * g[0]
                J[3], J[4], J[5] = g[0], g[1], g[2]
                for i in range(6):
                    b[i] += J[i] * distances[n]
                    for j in range(i + 1):
                        A[i, j] += J[i] * J[j]
                used += 1
                squares += distances[n] * distances[n]
            if used < 6:
                residuals[m] = np.inf
                break
            residuals[m] = math.sqrt(squares / used)
            for i in range(6):
                for j in range(i):
                    A[j, i] = A[i, j]
            for i in range(3):
                A[i, i] += 1e-5 * used
                A[i + 3, i + 3] += 1e-2 * used
            step = np.linalg.solve(A, b)
            apply_step(X, step, centre)
            if np.abs(step).max() < tolerance:
                break


@njit(cache=True, nogil=True, error_model="numpy")
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
    X[:3, :3] = R @ np.ascontiguousarray(X[:3, :3])
    X[:3, 3] = R @ (np.ascontiguousarray(X[:3, 3]) - centre) + centre + step[3:]
