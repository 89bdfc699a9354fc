# SPDX-License-Identifier: MIT
"""Normal equations of a Gauss-Newton step over the poses of several objects.

Each object has six unknowns: a turn w (rad) about its origin, then a shift v (m). As
the object moves, the signed distance d of a fixed point p to it changes by
-(r x g . w + g . v), with g the distance's gradient and r = p - origin. The distance of
a point of the object itself to another one changes by the opposite.
"""

from __future__ import annotations

import numpy as np

from physim_drake.compiled import compiled
from physim_drake.poses import Array


class NormalEquations:
    """Accumulates J^T W J and J^T W r.

    Attributes:
        A: left side, (6 N, 6 N) for N objects.
        b: right side, (6 N,).

    Args:
        origins: origins of the objects, (N, 3), m.
    """

    def __init__(self, origins: Array) -> None:
        self._origins = origins
        self.A = np.zeros((6 * len(origins), 6 * len(origins)))
        self.b = np.zeros(6 * len(origins))

    def add(
        self, n: int, points: Array, gradients: Array, residuals: Array, weights: Array
    ) -> None:
        """Adds fixed points (N, 3) near object `n`, with residuals and weights (N,)."""
        self.add_between(n, -1, points, gradients, residuals, weights)

    def add_between(
        self,
        n: int,
        m: int,
        points: Array,
        gradients: Array,
        residuals: Array,
        weights: Array,
    ) -> None:
        """Adds points that move with object `m`, by their distances to object `n`.

        Either may be -1, for a thing that does not move.
        """
        _add(self.A, self.b, self._origins, n, m, points, gradients, residuals, weights)

    def add_nearest(
        self,
        points: Array,
        distances: Array,
        gradients: Array,
        gate: float,
        scale: float,
    ) -> None:
        """Adds fixed points, each for the object that it is nearest to.

        Args:
            points: positions of the points, (N, 3), m.
            distances: distances to each object, (K, N), m.
            gradients: gradients of the distances, (K, N, 3).
            gate: distance from every object beyond which a point does not count, m.
            scale: scale of the Geman-McClure weights, m.
        """
        nearest = np.abs(distances).argmin(axis=0)
        for n in range(len(distances)):
            d = distances[n]
            weights = np.where(
                (nearest == n) & (np.abs(d) < gate), geman_mcclure(d, scale), 0.0
            )
            self.add(n, points, gradients[n], d, weights)

    def solve(self, damping: float) -> Array:
        """The step (N, 6) that lowers every residual.

        Args:
            damping: damping of shifts, relative to the mean of their diagonal
                entries. Turns are damped as shifts at a lever of 5 cm are.
        """
        shifts = np.tile([False, False, False, True, True, True], len(self._origins))
        scale = max(float(self.A.diagonal()[shifts].mean()), 1e-9)
        extra = np.where(shifts, damping, damping * 0.05**2) * scale
        step = np.linalg.solve(self.A + np.diag(extra), self.b)
        return np.asarray(step, np.float64).reshape(-1, 6)


def geman_mcclure(residual: Array, scale: float) -> Array:
    """Weights that fade for residuals beyond `scale`."""
    return np.asarray(1 / np.square(1 + np.square(residual / scale)))


@compiled(error_model="numpy")
def _add(
    A: Array,
    b: Array,
    origins: Array,
    n: int,
    m: int,
    points: Array,
    gradients: Array,
    residuals: Array,
    weights: Array,
) -> None:
    J = np.zeros((2, 6))
    for q in range(len(points)):
        weight = weights[q]
        if weight == 0:
            continue
        gx, gy, gz = gradients[q, 0], gradients[q, 1], gradients[q, 2]
        for side, k in enumerate((n, m)):
            if k < 0:
                continue
            sign = 1.0 if side == 0 else -1.0
            x = points[q, 0] - origins[k, 0]
            y = points[q, 1] - origins[k, 1]
            z = points[q, 2] - origins[k, 2]
            J[side, 0] = sign * (y * gz - z * gy)
            J[side, 1] = sign * (z * gx - x * gz)
            J[side, 2] = sign * (x * gy - y * gx)
            J[side, 3], J[side, 4], J[side, 5] = sign * gx, sign * gy, sign * gz
        for side, k in enumerate((n, m)):
            if k < 0:
                continue
            for i in range(6):
                weighted = weight * J[side, i]
                b[6 * k + i] += weighted * residuals[q]
                for other, o in enumerate((n, m)):
                    if o >= 0:
                        for j in range(6):
                            A[6 * k + i, 6 * o + j] += weighted * J[other, j]
