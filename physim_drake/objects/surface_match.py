# SPDX-License-Identifier: MIT
"""How far a surface lies from itself after a motion."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.spatial import KDTree

from physim_drake.poses import (
    Array,
    exp_pose,
    make_pose,
    nearest_rotation,
    transform_points,
)

_REFERENCE_POINTS = 30_000
_PROBE_POINTS = 800
_COARSE_POINTS = 100
_REFINE_POINTS = 400
_REFINE_STEPS = 8


class SurfaceMatch:
    """A surface sampled twice: densely, and sparsely to be moved against it.

    Attributes:
        centroid: of the surface, (3,), m.
        covariance: second moments of the surface about it, (3, 3), m^2.
        centres: the points (N, 3), m, about which symmetric motions may turn: the
            centroid, and the middle of the extents along the principal axes.

    Args:
        mesh: the surface, m.
    """

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        sampled = trimesh.sample.sample_surface(mesh, _REFERENCE_POINTS, seed=1)
        points, faces = sampled[:2]
        self._points = np.asarray(points)
        self._normals = np.asarray(mesh.face_normals)[faces]
        self._tree = KDTree(self._points)
        self._spacing = 1.5 * float(np.sqrt(mesh.area / _REFERENCE_POINTS))
        self._probes = np.asarray(
            trimesh.sample.sample_surface(mesh, _PROBE_POINTS, seed=2)[0]
        )
        self.centroid, self.covariance = _moments(mesh)
        axes = np.linalg.eigh(self.covariance)[1]
        local = np.asarray(mesh.vertices) @ axes
        middle = axes @ (local.min(axis=0) + local.max(axis=0)) / 2
        self.centres = np.stack([self.centroid, middle])

    @staticmethod
    def about(R: Array, point: Array) -> Array:
        """The (4, 4) motion that turns by `R` (3, 3) about `point` (3,), m."""
        return make_pose(R, point - R @ point)

    def fixed_point(self, motions: Array) -> Array:
        """The point (3,), m, that motions (N, 4, 4) move least, near the centroid."""
        A = (np.eye(3) - motions[:, :3, :3]).reshape(-1, 3)
        b = motions[:, :3, 3].reshape(-1) - A @ self.centroid
        # Along an axis of all motions nothing moves: the shortest step stays there.
        return np.asarray(self.centroid + np.linalg.lstsq(A, b, rcond=0.1)[0])

    def deviations(self, motions: Array) -> Array:
        """The distances within which 95 % of the moved surface lie, (N,), m.

        Or a quarter of that within which 98 % lie, if it is more: a handle is a small
        part of a mug, but far from where it was.

        Args:
            motions: (N, 4, 4).
        """
        distances = self._distances(transform_points(motions, self._probes))
        most, nearly_all = np.percentile(distances, (95, 98), axis=-1)
        return np.asarray(np.maximum(most, nearly_all / 4))

    def coarse_deviations(self, motions: Array) -> Array:
        """Mean distances of few moved points, (N,), m; for motions (N, 4, 4)."""
        moved = transform_points(motions, self._probes[:_COARSE_POINTS])
        return np.asarray(np.mean(self._tree.query(moved)[0], axis=-1))

    def refine(self, X: Array) -> Array:
        """Moves a motion (4, 4) to where it matches best, by point-to-plane ICP.

        Chen and Medioni (1992), with the worst tenth of the points left out.
        """
        for _ in range(_REFINE_STEPS):
            moved = transform_points(X, self._probes[:_REFINE_POINTS])
            _, nearest = self._tree.query(moved)
            normals = self._normals[nearest]
            residual = np.einsum("ij,ij->i", normals, moved - self._points[nearest])
            kept = np.abs(residual) <= np.percentile(np.abs(residual), 90)
            arms = moved - self.centroid
            J = np.concatenate([np.cross(arms, normals), normals], axis=1)[kept]
            # Motions along the surface are not determined; rcond leaves them alone.
            scale = np.repeat([1 / np.sqrt(np.trace(self.covariance)), 1.0], 3)
            step = -scale * np.linalg.lstsq(J * scale, residual[kept], rcond=0.05)[0]
            delta = exp_pose(np.asarray(step, np.float64))
            R = nearest_rotation(delta[:3, :3] @ X[:3, :3])
            p = delta[:3, :3] @ (X[:3, 3] - self.centroid) + self.centroid
            X = make_pose(R, p + step[3:])
            if np.linalg.norm(step[:3]) < 1e-4 and np.linalg.norm(step[3:]) < 1e-5:
                break
        return X

    def _distances(self, points: Array) -> Array:
        """Distances of points (..., 3) from the surface, (...), m.

        To the tangent plane at a sample, where its foot is no farther from the sample
        than samples are apart: nearly exact with samples much sparser than the result.
        """
        _, nearest = self._tree.query(points, k=4)
        offset = points[..., None, :] - self._points[nearest]
        height = np.einsum("...i,...i->...", offset, self._normals[nearest])
        along = np.sqrt(np.maximum((offset**2).sum(axis=-1) - height**2, 0.0))
        beyond = np.maximum(along - self._spacing, 0.0)
        return np.asarray(np.hypot(height, beyond).min(axis=-1))


def _moments(mesh: trimesh.Trimesh) -> tuple[Array, Array]:
    """Centroid (3,), m, and covariance (3, 3), m^2, of a surface, exactly."""
    corners = np.asarray(mesh.triangles)
    weights = np.asarray(mesh.area_faces) / float(mesh.area)
    centroid = weights @ corners.mean(axis=1)
    corners = corners - centroid
    total = corners.sum(axis=1)
    moments = np.einsum("f,fki,fkj->ij", weights, corners, corners)
    moments += np.einsum("f,fi,fj->ij", weights, total, total)
    return np.asarray(centroid), np.asarray(moments / 12)
