# SPDX-License-Identifier: MIT
"""Rigid transforms as 4 x 4 arrays, and the symmetries of objects.

Poses follow Drake's monogram notation: ``X_AB`` is the pose of frame B in frame A,
a (4, 4) float array, or (N, 4, 4) for many.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def make_pose(R: ArrayLike | None = None, p: ArrayLike | None = None) -> Array:
    """Returns the (4, 4) pose with rotation `R` (3, 3) and translation `p` (3,), m."""
    X = np.eye(4)
    if R is not None:
        X[:3, :3] = R
    if p is not None:
        X[:3, 3] = p
    return X


def inverse(X: Array) -> Array:
    """Inverts poses (..., 4, 4)."""
    R_T = np.swapaxes(X[..., :3, :3], -1, -2)
    result = np.zeros_like(X)
    result[..., :3, :3] = R_T
    result[..., :3, 3] = -np.einsum("...ij,...j->...i", R_T, X[..., :3, 3])
    result[..., 3, 3] = 1.0
    return result


def transform_points(X_AB: Array, p_B: Array) -> Array:
    """Expresses points `p_B` (N, 3) in A; for (M, 4, 4) poses returns (M, N, 3)."""
    R_T = np.swapaxes(X_AB[..., :3, :3], -1, -2)
    return np.asarray(p_B @ R_T + X_AB[..., None, :3, 3])


def exp_pose(xi: Array) -> Array:
    """Returns poses (..., 4, 4) for small motions `xi` (..., 6): rotation vector, m.

    Rotation and translation are applied separately (X = [exp(w) v; 0 1]), as all
    solvers here do.
    """
    flat = np.reshape(xi, (-1, 6))
    X = np.zeros((len(flat), 4, 4))
    X[:, :3, :3] = Rotation.from_rotvec(flat[:, :3]).as_matrix()
    X[:, :3, 3] = flat[:, 3:]
    X[:, 3, 3] = 1.0
    return X.reshape(*np.shape(xi)[:-1], 4, 4)


def rotation_angle(R: Array) -> Array:
    """Rotation angles in radians of matrices (..., 3, 3), exact near 0 and pi."""
    skew = np.stack(
        [
            R[..., 2, 1] - R[..., 1, 2],
            R[..., 0, 2] - R[..., 2, 0],
            R[..., 1, 0] - R[..., 0, 1],
        ],
        axis=-1,
    )
    sine = np.linalg.norm(skew, axis=-1) / 2
    cosine = (np.trace(R, axis1=-2, axis2=-1) - 1) / 2
    return np.asarray(np.arctan2(sine, cosine))


def is_rotation(R: Array, tolerance: float = 1e-3) -> bool:
    """Whether `R` (3, 3) is finite, orthonormal and right-handed within tolerance."""
    return bool(
        np.isfinite(R).all()
        and np.abs(R).max() < 2  # so that the product cannot overflow
        and np.abs(R @ R.T - np.eye(3)).max() < tolerance
        and np.linalg.det(R) > 0
    )


def nearest_rotation(R: Array) -> Array:
    """Projects matrices (..., 3, 3) onto SO(3) in the Frobenius norm."""
    U, _, Vt = np.linalg.svd(R)
    sign = np.linalg.det(U @ Vt)
    U[..., :, 2] *= sign[..., None]
    return np.asarray(U @ Vt)


@dataclass(frozen=True)
class ContinuousAxis:
    """An axis in O about which the object looks the same at every angle.

    Attributes:
        axis: direction of the axis, a unit vector (3,).
        point: point on the axis, (3,), m.
    """

    axis: Array
    point: Array

    def pose(self, angle: float) -> Array:
        """The (4, 4) symmetry that turns the object onto itself by `angle` (rad)."""
        R = Rotation.from_rotvec(angle * self.axis).as_matrix()
        return make_pose(R, self.point - R @ self.point)


@dataclass(frozen=True)
class SymmetryGroup:
    """The rigid motions that map an object onto itself.

    Every element is a discrete one, or a discrete one after a turn about the
    continuous axis. If two continuous axes are not parallel, the object is a ball.

    Attributes:
        discrete: discrete motions X_OS, (K, 4, 4), the identity first.
        axes: continuous axes.
    """

    discrete: Array = field(default_factory=lambda: np.eye(4)[None])
    axes: tuple[ContinuousAxis, ...] = ()

    def resized(self, scale: float) -> SymmetryGroup:
        """The symmetries of an object that is larger by `scale`."""
        discrete = self.discrete.copy()
        discrete[:, :3, 3] *= scale
        axes = tuple(replace(a, point=a.point * scale) for a in self.axes)
        return SymmetryGroup(discrete, axes)

    @property
    def is_ball(self) -> bool:
        """Whether every rotation about the centre is a symmetry."""
        return any(
            np.linalg.norm(np.cross(a.axis, self.axes[0].axis)) > 1e-3
            for a in self.axes[1:]
        )

    @property
    def centre(self) -> Array:
        """The point nearest to all continuous axes, (3,), m, or the origin."""
        if not self.axes:
            return np.zeros(3)
        projectors = [np.eye(3) - np.outer(a.axis, a.axis) for a in self.axes]
        rhs = sum(P @ a.point for P, a in zip(projectors, self.axes, strict=True))
        point = np.linalg.lstsq(sum(projectors), rhs, rcond=None)[0]
        return np.asarray(point, np.float64)

    def rotation_distance(
        self, R_WA: Array, R_WB: Array, pairwise: bool = False
    ) -> Array:
        """Smallest angles (rad) from A to any symmetric equivalent of B.

        With unit quaternions, an equivalent of B is q_B s, its angle from A
        2 acos |q_A . q_B s|; for a turn w about a continuous axis the dot product is
        u cos(w/2) + v sin(w/2), whose largest value is hypot(u, v).

        Args:
            R_WA: rotations, (N, 3, 3), or one, (3, 3).
            R_WB: rotations, (M, 3, 3), or one, (3, 3). Unless `pairwise`, M is N.
            pairwise: whether to compare every A with every B.

        Returns:
            (N,), or (N, M) if pairwise.
        """
        q_A = Rotation.from_matrix(R_WA.reshape(-1, 3, 3)).as_quat()
        R_WB = R_WB.reshape(-1, 3, 3)

        def dot(R: Array) -> Array:
            q_B = Rotation.from_matrix(R_WB @ R).as_quat()
            return np.asarray(q_A @ q_B.T if pairwise else (q_A * q_B).sum(axis=-1))

        if self.is_ball:
            return np.zeros_like(dot(np.eye(3)))
        best: Array | None = None
        half_turn = self.axes and Rotation.from_rotvec(np.pi * self.axes[0].axis)
        for X in self.discrete:
            cosine = np.abs(dot(X[:3, :3]))
            if half_turn:
                cosine = np.hypot(cosine, dot(half_turn.as_matrix() @ X[:3, :3]))
            best = cosine if best is None else np.maximum(best, cosine)
        assert best is not None
        return 2 * np.arccos(np.clip(best, 0.0, 1.0))

    def sampled(self, steps: int = 36) -> Array:
        """All symmetries, (K * steps, 4, 4): continuous turns in `steps` steps.

        A ball is sampled about three axes. This is enough for distances between
        surfaces, but not for rotations.
        """
        poses = [self.discrete]
        for axis in self.axes:
            turns = np.stack(
                [axis.pose(w) for w in 2 * np.pi * np.arange(steps) / steps]
            )
            poses.append((turns[:, None] @ self.discrete[None]).reshape(-1, 4, 4))
        return np.concatenate(poses[1:] if self.axes else poses)
