# SPDX-License-Identifier: MIT
"""How far an estimated pose is from the true one.

A symmetry S maps the object onto itself, so the estimate is compared with X_CO S for
the true pose X_CO. VSD is in `physim_drake.evaluation.visible_surface`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from physim_drake.camera import CameraIntrinsics
from physim_drake.poses import (
    Array,
    SymmetryGroup,
    inverse,
    make_pose,
    rotation_angle,
    transform_points,
)

SYMMETRY_STEPS = 315
"""Number of turns that sample a continuous axis in MSSD and MSPD: ceil(pi / 0.01), so
that no point moves by more than 0.01 diameter between two of them (max_sym_disc_step of
bop_toolkit)."""

_TIE = np.radians(1e-6)
_CHUNK_POINTS = 500_000


@dataclass(frozen=True)
class PoseError:
    """Errors of rotation and translation after symmetry.

    Attributes:
        rpy_mean: mean of |roll|, |pitch| and |yaw| in the object frame, rad, smallest
            over the symmetries; the rotation error of Mitash et al. 2018.
        geodesic: rotation angle, smallest over the symmetries, rad.
        translation: distance of the origins under the symmetry that minimises
            `geodesic`, m, the nearest one if there are several. For a ball it is the
            distance of the centres.
        candidates: angle (rad) and distance (m) for each discrete symmetry, at the best
            turn about a continuous axis, (K, 2).
    """

    rpy_mean: float
    geodesic: float
    translation: float
    candidates: Array

    @property
    def geodesic_deg(self) -> float:
        """`geodesic` in degrees."""
        return float(np.degrees(self.geodesic))

    @property
    def translation_mm(self) -> float:
        """`translation` in mm."""
        return 1000 * self.translation

    def within(self, angle: float, distance: float) -> bool:
        """Whether any symmetry is within both limits (rad, m)."""
        return bool((self.candidates <= [angle, distance]).all(1).any())


def pose_error(X_CO_true: Array, X_CO: Array, symmetry: SymmetryGroup) -> PoseError:
    """Compares the estimate `X_CO` with `X_CO_true`, both (4, 4), m."""
    if symmetry.is_ball:
        centres = transform_points(np.stack([X_CO_true, X_CO]), symmetry.centre[None])
        distance = float(np.linalg.norm(centres[1] - centres[0]))
        return PoseError(0.0, 0.0, distance, np.array([[0.0, distance]]))
    R_true_est = X_CO_true[:3, :3].T @ X_CO[:3, :3]
    X_OS = _nearest_symmetries(R_true_est, symmetry)
    angles = rotation_angle(np.swapaxes(X_OS[:, :3, :3], 1, 2) @ R_true_est)
    origins = (X_CO_true @ X_OS)[:, :3, 3]
    distances = np.linalg.norm(X_CO[:3, 3] - origins, axis=1)
    return PoseError(
        _least_rpy_mean(R_true_est, symmetry),
        float(angles.min()),
        float(distances[angles <= angles.min() + _TIE].min()),
        np.stack([angles, distances], axis=1),
    )


def mean_rpy(R: Array) -> Array:
    """Mean of |roll|, |pitch|, |yaw| (rad) of R = Rz(yaw) Ry(pitch) Rx(roll).

    Args:
        R: rotations (..., 3, 3). At pitch +-90 degrees yaw is taken as zero.

    Returns:
        The means (...).
    """
    cosine = np.hypot(R[..., 0, 0], R[..., 1, 0])
    pitch = np.arctan2(-R[..., 2, 0], cosine)
    locked = cosine < 1e-9
    roll = np.where(
        locked,
        np.arctan2(-R[..., 1, 2], R[..., 1, 1]),
        np.arctan2(R[..., 2, 1], R[..., 2, 2]),
    )
    yaw = np.where(locked, 0.0, np.arctan2(R[..., 1, 0], R[..., 0, 0]))
    return np.asarray((np.abs(roll) + np.abs(pitch) + np.abs(yaw)) / 3)


def add(points: Array, X_CO_true: Array, X_CO: Array) -> float:
    """Mean distance (m) of the same points p_OP (N, 3) under both poses (ADD).

    Hinterstoisser et al., "Model based training, detection and pose estimation of
    texture-less 3D objects in heavily cluttered scenes", ACCV 2012.
    """
    difference = transform_points(X_CO, points) - transform_points(X_CO_true, points)
    return float(np.mean(np.linalg.norm(difference, axis=1)))


def add_s(points: Array, X_CO_true: Array, X_CO: Array) -> float:
    """Mean distance (m) from each true point to the nearest estimated one (ADD-S).

    Args:
        points: points p_OP spread evenly over the surface, (N, 3), m.
        X_CO_true: true pose, (4, 4), m.
        X_CO: estimate, (4, 4), m.
    """
    # In the estimate's frame one tree of the points serves every call.
    p_true = transform_points(inverse(X_CO) @ X_CO_true, points)
    return float(np.mean(KDTree(points).query(p_true)[0]))


def symmetry_samples(symmetry: SymmetryGroup, X_CO_true: Array, X_CO: Array) -> Array:
    """The symmetries X_OS (M, 4, 4) over which MSSD and MSPD are minimised.

    Continuous ones are sampled in `SYMMETRY_STEPS` turns. A ball has a single sample,
    the turn about its centre that aligns both rotations: no other brings its farthest
    point nearer.
    """
    if symmetry.is_ball:
        R = X_CO_true[:3, :3].T @ X_CO[:3, :3]
        return make_pose(R, symmetry.centre - R @ symmetry.centre)[None]
    return symmetry.sampled(SYMMETRY_STEPS)


def mssd(vertices: Array, X_CO_true: Array, X_CO: Array, X_OS: Array) -> float:
    """Maximum symmetry-aware surface distance, m (BOP challenge 2019).

    Args:
        vertices: vertices p_OV of the mesh, (N, 3), m. Those of its convex hull give
            the same result: the distance is convex in the point, so a vertex of the
            hull is farthest.
        X_CO_true: true pose, (4, 4), m.
        X_CO: estimate, (4, 4), m.
        X_OS: symmetries (M, 4, 4) of `symmetry_samples`.
    """
    estimated = transform_points(X_CO, vertices)
    return min(
        float(np.linalg.norm(points - estimated, axis=2).max(1).min())
        for points in _moved(vertices, X_CO_true, X_OS)
    )


def mspd(
    vertices: Array,
    X_CO_true: Array,
    X_CO: Array,
    X_OS: Array,
    intrinsics: CameraIntrinsics,
) -> float:
    """Maximum symmetry-aware projection distance, px (BOP challenge 2019).

    Args:
        vertices: all vertices p_OV of the mesh, (N, 3), m.
        X_CO_true: true pose, (4, 4), m.
        X_CO: estimate, (4, 4), m.
        X_OS: symmetries (M, 4, 4) of `symmetry_samples`.
        intrinsics: camera of the image.
    """
    estimated = intrinsics.project(transform_points(X_CO, vertices))
    return min(
        float(
            np.linalg.norm(intrinsics.project(points) - estimated, axis=2).max(1).min()
        )
        for points in _moved(vertices, X_CO_true, X_OS)
    )


def _moved(vertices: Array, X_CO_true: Array, X_OS: Array) -> list[Array]:
    """p_CV (m, N, 3) under the symmetric true poses, in blocks that fit in memory."""
    blocks = max(1, len(X_OS) * len(vertices) // _CHUNK_POINTS)
    return [
        transform_points(X_CO_true @ X, vertices) for X in np.array_split(X_OS, blocks)
    ]


def _nearest_symmetries(R_true_est: Array, symmetry: SymmetryGroup) -> Array:
    """For each discrete symmetry, X_OS (K, 4, 4) turned nearest to `R_true_est`.

    The turn C(w) about axis a that brings C(w) D nearest to R maximises
    tr(C(w)^T M), M = R D^T, which is cos(w)(tr M - a.Ma) + sin(w) [a]x.M + a.Ma.
    """
    if not symmetry.axes:
        return symmetry.discrete
    axis = symmetry.axes[0]
    a = axis.axis
    turned = []
    for D in symmetry.discrete:
        M = R_true_est @ D[:3, :3].T
        vee = np.array([M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]])
        angle = float(np.arctan2(a @ vee, np.trace(M) - a @ M @ a))
        turned.append(axis.pose(angle) @ D)
    return np.stack(turned)


def _least_rpy_mean(R_true_est: Array, symmetry: SymmetryGroup) -> float:
    """Smallest `mean_rpy` over the symmetries, rad.

    For a continuous axis there is no closed form. It is searched in steps of 1 degree,
    then refined within one step of the best.
    """
    R_SO = np.swapaxes(symmetry.discrete[:, :3, :3], 1, 2)
    if not symmetry.axes:
        return float(mean_rpy(R_SO @ R_true_est).min())
    a = symmetry.axes[0].axis

    def errors(angles: Array) -> Array:
        turns_back = Rotation.from_rotvec(-angles[:, None] * a).as_matrix()
        return mean_rpy(R_SO[:, None] @ (turns_back @ R_true_est))

    angles = np.radians(np.arange(360.0))
    coarse = errors(angles)
    best = float(coarse.min())
    for k, angle in enumerate(angles[coarse.argmin(axis=1)]):
        window = angle + np.radians([-1.0, 1.0])
        fine = minimize_scalar(
            lambda w, k=k: errors(np.array([w]))[k, 0],
            bounds=tuple(window),
            method="bounded",
            options={"xatol": np.radians(1e-4)},
        )
        best = min(best, float(fine.fun))
    return best
