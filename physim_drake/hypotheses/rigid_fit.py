# SPDX-License-Identifier: MIT
"""The rigid motion that puts a few points and normals on others, in closed form.

The quaternion method of Horn (1987), its largest eigenvalue found by Newton's method
on the characteristic polynomial as Theobald (2005) does: no decomposition is needed.
"""

from __future__ import annotations

import math

import numpy as np

from physim_drake.compiled import compiled
from physim_drake.hypotheses.pairs import Points
from physim_drake.poses import Array

_NEWTON_STEPS = 30
_NORMAL_WEIGHT = 0.3  # of a normal, against a point at the set's mean distance


@compiled(error_model="numpy")
def fit_sets(
    points: Array,
    normals: Array,
    model: Array,
    model_normals: Array,
    sets: Points,
    max_rms: float,
    poses: Array,
) -> int:
    """Least-squares poses of congruent sets, from points and normals.

    Args:
        points: points of the base, (4, 3), m.
        normals: unit normals at the points, (4, 3).
        model: p_O of all model points, (N, 3), m.
        model_normals: unit normals at the points, (N, 3).
        sets: indices of model points, (M, 4).
        max_rms: a pose whose points are farther from the base is dropped, m.
        poses: array that the poses X_SO are written to, (K, 4, 4). Poses that do not
            fit in it are left out.

    Returns:
        how many were written.
    """
    centre_S = np.zeros(3)
    for k in range(4):
        centre_S += points[k] / 4
    arms = points - centre_S
    weight = _NORMAL_WEIGHT * np.square(arms).sum() / 4
    H, R, centre_O = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    count = 0
    for m in range(len(sets)):
        if count == len(poses):
            break
        for x in range(3):
            centre_O[x] = 0.0
            for k in range(4):
                centre_O[x] += model[sets[m, k], x] / 4
        for x in range(3):
            for y in range(3):
                H[x, y] = 0.0
                for k in range(4):
                    H[x, y] += arms[k, x] * (model[sets[m, k], y] - centre_O[y])
                    H[x, y] += weight * normals[k, x] * model_normals[sets[m, k], y]
        best_rotation(H, R)
        squares = 0.0
        for x in range(3):
            for k in range(4):
                residual = arms[k, x]
                for y in range(3):
                    residual -= R[x, y] * (model[sets[m, k], y] - centre_O[y])
                squares += residual * residual
        if squares < 4 * max_rms * max_rms:
            poses[count, :3, :3] = R
            poses[count, :3, 3] = centre_S - R @ centre_O
            poses[count, 3, 3] = 1.0
            count += 1
    return count


@compiled(error_model="numpy")
def best_rotation(H: Array, R: Array) -> None:
    """Writes the rotation (3, 3) that maximises the trace of R^T H to `R`.

    Args:
        H: correlation, (3, 3): the sum of target times source, transposed.
        R: the result.
    """
    N = np.empty((4, 4))
    N[0, 0] = H[0, 0] + H[1, 1] + H[2, 2]
    N[1, 1] = H[0, 0] - H[1, 1] - H[2, 2]
    N[2, 2] = H[1, 1] - H[0, 0] - H[2, 2]
    N[3, 3] = H[2, 2] - H[0, 0] - H[1, 1]
    N[0, 1] = N[1, 0] = H[2, 1] - H[1, 2]
    N[0, 2] = N[2, 0] = H[0, 2] - H[2, 0]
    N[0, 3] = N[3, 0] = H[1, 0] - H[0, 1]
    N[1, 2] = N[2, 1] = H[0, 1] + H[1, 0]
    N[1, 3] = N[3, 1] = H[0, 2] + H[2, 0]
    N[2, 3] = N[3, 2] = H[1, 2] + H[2, 1]
    eigenvalue = _largest_eigenvalue(H, N)
    for i in range(4):
        N[i, i] -= eigenvalue
    q = _null_vector(N)
    w, x, y, z = q[0], q[1], q[2], q[3]
    R[0, 0], R[1, 1] = 1 - 2 * (y * y + z * z), 1 - 2 * (x * x + z * z)
    R[2, 2] = 1 - 2 * (x * x + y * y)
    R[0, 1], R[1, 0] = 2 * (x * y - w * z), 2 * (x * y + w * z)
    R[0, 2], R[2, 0] = 2 * (x * z + w * y), 2 * (x * z - w * y)
    R[1, 2], R[2, 1] = 2 * (y * z - w * x), 2 * (y * z + w * x)


@compiled(error_model="numpy")
def _largest_eigenvalue(H: Array, N: Array) -> float:
    """Of N, whose characteristic polynomial has no cubic term."""
    squares = 0.0
    for i in range(3):
        for j in range(3):
            squares += H[i, j] * H[i, j]
    c2 = -2 * squares
    c1 = -8 * _det3(H, 0, 1, 2, 0, 1, 2)
    c0 = (
        N[0, 0] * _det3(N, 1, 2, 3, 1, 2, 3)
        - N[0, 1] * _det3(N, 1, 2, 3, 0, 2, 3)
        + N[0, 2] * _det3(N, 1, 2, 3, 0, 1, 3)
        - N[0, 3] * _det3(N, 1, 2, 3, 0, 1, 2)
    )
    # From above the largest root Newton's method comes down to it without fail.
    x = math.sqrt(3 * squares)
    for _ in range(_NEWTON_STEPS):
        value = ((x * x + c2) * x + c1) * x + c0
        slope = (4 * x * x + 2 * c2) * x + c1
        if slope <= 0:
            break
        step = value / slope
        x -= step
        if abs(step) < 1e-12 * abs(x):
            break
    return x


@compiled(error_model="numpy")
def _null_vector(N: Array) -> Array:
    """The unit vector that a singular, symmetric (4, 4) matrix maps to nearly zero.

    Every row of the adjugate is a multiple of it; the longest is the most exact.
    """
    best = np.zeros(4)
    row = np.empty(4)
    longest = 0.0
    for i in range(4):
        r0, r1, r2 = (i + 1) % 4, (i + 2) % 4, (i + 3) % 4
        sign = 1.0
        for j in range(4):
            c0, c1, c2 = (j + 1) % 4, (j + 2) % 4, (j + 3) % 4
            row[j] = sign * _det3(N, r0, r1, r2, c0, c1, c2)
            sign = -sign
        length = 0.0
        for j in range(4):
            length += row[j] * row[j]
        if length > longest:
            longest = length
            best[:] = row
    if longest == 0:
        best[0] = 1.0
        return best
    return best / math.sqrt(longest)


@compiled(error_model="numpy")
def _det3(M: Array, a: int, b: int, c: int, i: int, j: int, k: int) -> float:
    """Determinant of rows a, b, c and columns i, j, k."""
    return float(
        M[a, i] * (M[b, j] * M[c, k] - M[b, k] * M[c, j])
        - M[a, j] * (M[b, i] * M[c, k] - M[b, k] * M[c, i])
        + M[a, k] * (M[b, i] * M[c, j] - M[b, j] * M[c, i])
    )
