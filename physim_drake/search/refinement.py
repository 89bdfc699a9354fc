# SPDX-License-Identifier: MIT
"""Refines all objects of a state together, and tells refined states apart.

A damped Gauss-Newton over the poses of all objects at once on four kinds of residual:
observed points on the nearest object's surface, rendered pixels that the camera saw
through, overlap between bodies and with the surface, and contacts, which are kept.
Everything but the silhouettes is read off the objects' distance fields.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from physim_drake.objects import ObjectModel
from physim_drake.observation import Mask
from physim_drake.poses import Array, exp_pose, inverse, transform_points
from physim_drake.registration_model import registration_model
from physim_drake.search.states import Placement, StateRenderer


@dataclass(frozen=True)
class RefinementConfig:
    """Weights and scales of the joint refinement.

    Attributes:
        iterations: of Gauss-Newton.
        redraw: the silhouettes are drawn anew every so many iterations.
        points: observed points an object, at most.
        gate: a point farther than this from every object counts for none, m.
        scale: residuals beyond this lose their pull (Geman-McClure), m.
        cutoff: of the fine cost: a pixel errs by this at most, m.
        see_past: the camera saw past a rendered pixel where it measured more than
            this behind it, m.
        silhouette_weight: of a pixel seen through, against an observed point.
        overlap_weight: of an overlapping surface point.
        contact_weight: of a touching surface point.
        contact_gap: surfaces nearer than this touch, m.
    """

    iterations: int = 24
    redraw: int = 4
    points: int = 1500
    gate: float = 0.015
    scale: float = 0.004
    cutoff: float = 0.01
    see_past: float = 0.006
    silhouette_weight: float = 0.3
    overlap_weight: float = 3.0
    contact_weight: float = 0.3
    contact_gap: float = 0.002


class _NormalEquations:
    """Accumulates J^T W J and J^T W r over 6 unknowns an object: turn, then shift."""

    def __init__(self, count: int) -> None:
        self.A = np.zeros((6 * count, 6 * count))
        self.b = np.zeros(6 * count)

    def add(self, blocks: Mapping[int, Array], residual: Array, weight: Array) -> None:
        """Adds rows: `blocks` holds each object's (N, 6) part of the Jacobian."""
        for i, J in blocks.items():
            weighted = J * weight[:, None]
            self.b[6 * i : 6 * i + 6] += weighted.T @ residual
            for j, K in blocks.items():
                self.A[6 * i : 6 * i + 6, 6 * j : 6 * j + 6] += weighted.T @ K


class JointRefiner:
    """Refines states of one scene.

    Args:
        renderer: draws the scene's states.
        models: the object of each index of the scene.
        config: weights and scales.
    """

    def __init__(
        self,
        renderer: StateRenderer,
        models: Sequence[ObjectModel],
        config: RefinementConfig = RefinementConfig(),
    ) -> None:
        self._renderer, self._models, self.config = renderer, models, config
        scene = renderer.scene
        self._X_SC = inverse(scene.X_CS)
        self._points_C = scene.intrinsics.unproject(scene.observed)

    def refine(self, placed: Placement) -> dict[int, Array]:
        """Refines the poses of all placed objects together.

        Args:
            placed: X_SO by index.

        Returns:
            the refined X_SO, by index.
        """
        indices = list(placed)
        poses = {k: placed[k].copy() for k in indices}
        points = self._observed_points(indices)
        silhouettes: dict[int, tuple[Array, Array]] = {}
        contacts = self._contacts(poses)
        for iteration in range(self.config.iterations):
            if iteration % self.config.redraw == 0:
                silhouettes = self._silhouettes(poses)
            equations = _NormalEquations(len(indices))
            self._add_points(equations, indices, poses, points)
            self._add_silhouettes(equations, indices, poses, silhouettes)
            self._add_bodies(equations, indices, poses, contacts)
            step = _damped_solve(equations).reshape(-1, 6)
            for n, k in enumerate(indices):
                D = exp_pose(step[n])
                poses[k][:3, :3] = D[:3, :3] @ poses[k][:3, :3]
                poses[k][:3, 3] += D[:3, 3]
        return poses

    def fine_cost(self, placed: Placement) -> float:
        """How badly a state explains the image, in pixels; finer than the score C.

        Each rendered pixel costs its depth error, cut at `cutoff` and in units of it;
        each pixel of the segments that nothing is rendered in costs 1.
        """
        scene = self._renderer.scene
        image = self._renderer.image(placed)
        drawn = (image > 0) & (scene.depth > 0)
        error = np.abs(image - scene.depth)[drawn] / self.config.cutoff
        missed = self._mask(list(placed)) & (scene.observed > 0) & (image == 0)
        return float(np.minimum(error, 1.0).sum() + np.count_nonzero(missed))

    def _mask(self, indices: Sequence[int]) -> Mask:
        masks = [self._renderer.scene.segments[k].mask for k in indices]
        return np.asarray(np.logical_or.reduce(masks))

    def _observed_points(self, indices: Sequence[int]) -> Array:
        """Observed foreground points p_S (N, 3) of the objects' segments."""
        mask = self._mask(indices) & (self._renderer.scene.observed > 0)
        points = self._points_C[mask]
        limit = self.config.points * len(indices)
        if len(points) > limit:
            points = points[:: -(-len(points) // limit)]
        return transform_points(self._X_SC, points)

    def _add_points(
        self,
        equations: _NormalEquations,
        indices: Sequence[int],
        poses: Placement,
        points: Array,
    ) -> None:
        found = [_surface_distance(self._models[k], poses[k], points) for k in indices]
        nearest = np.abs(np.stack([d for d, _ in found])).argmin(axis=0)
        for n, k in enumerate(indices):
            d, g = found[n]
            use = (nearest == n) & (np.abs(d) < self.config.gate)
            weight = _geman_mcclure(d[use], self.config.scale)
            J = _jacobian(points[use], g[use], poses[k])
            equations.add({n: J}, d[use], weight)

    def _silhouettes(self, poses: Placement) -> dict[int, tuple[Array, Array]]:
        """What each object hides that the camera saw: p_O, and targets p_S (N, 3).

        The target of a point is where it would be in the nearest pixel in which the
        camera did not see past it.
        """
        scene = self._renderer.scene
        image, labels = self._renderer.labels(poses)
        seen_past = (image > 0) & (scene.depth > image + self.config.see_past)
        background = (image == 0) & (scene.observed == 0) & (scene.depth > 0)
        closed = seen_past | background
        _, nearest = cv2.distanceTransformWithLabels(
            closed.astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        rows, columns = np.nonzero(~closed)
        seeds = np.zeros((nearest.max() + 1, 2))
        seeds[nearest[rows, columns]] = np.stack([columns, rows], axis=1)
        rays = scene.intrinsics.rays()
        result = {}
        for k in poses:
            v, u = np.nonzero((labels == k) & seen_past)
            step = max(1, len(v) // self.config.points)
            v, u = v[::step], u[::step]
            z = image[v, u].astype(float)[:, None]
            to_u, to_v = seeds[nearest[v, u]].astype(int).T
            p_S = transform_points(self._X_SC, rays[v, u] * z)
            target_S = transform_points(self._X_SC, rays[to_v, to_u] * z)
            result[k] = (transform_points(inverse(poses[k]), p_S), target_S)
        return result

    def _add_silhouettes(
        self,
        equations: _NormalEquations,
        indices: Sequence[int],
        poses: Placement,
        silhouettes: Mapping[int, tuple[Array, Array]],
    ) -> None:
        """Pulls the points seen past sideways, to where the object may be."""
        for n, k in enumerate(indices):
            points_O, target = silhouettes[k]
            points = transform_points(poses[k], points_O)
            way = target - points
            length = np.linalg.norm(way, axis=1)
            direction = way / np.maximum(length, 1e-9)[:, None]
            weight = self.config.silhouette_weight * _geman_mcclure(
                length, 3 * self.config.scale
            )
            equations.add({n: _jacobian(points, direction, poses[k])}, length, weight)

    def _contacts(self, poses: Placement) -> dict[tuple[int, int], Mask]:
        """Which surface points of i touch j at the start (j = -1: the surface)."""
        touching = {}
        for i, X in poses.items():
            points = transform_points(X, registration_model(self._models[i]).points)
            touching[i, -1] = np.abs(points[:, 2]) < self.config.contact_gap
            for j, Y in poses.items():
                if j != i:
                    d, _ = _surface_distance(self._models[j], Y, points)
                    touching[i, j] = np.abs(d) < self.config.contact_gap
        return touching

    def _add_bodies(
        self,
        equations: _NormalEquations,
        indices: Sequence[int],
        poses: Placement,
        contacts: Mapping[tuple[int, int], Mask],
    ) -> None:
        """Overlap is pushed out, contact kept: with the surface and between objects."""
        for n, i in enumerate(indices):
            model = registration_model(self._models[i])
            points = transform_points(poses[i], model.points)
            up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
            weight = self._body_weight(points[:, 2], contacts[i, -1])
            use = weight > 0
            J = -_jacobian(points[use], up[use], poses[i])
            equations.add({n: J}, points[use, 2], weight[use])
            for m, j in enumerate(indices):
                if j == i:
                    continue
                d, g = _surface_distance(self._models[j], poses[j], points)
                weight = self._body_weight(d, contacts[i, j])
                use = weight > 0
                if use.any():
                    J_j = _jacobian(points[use], g[use], poses[j])
                    J_i = -_jacobian(points[use], g[use], poses[i])
                    equations.add({m: J_j, n: J_i}, d[use], weight[use])

    def _body_weight(self, gap: Array, touching: Mask) -> Array:
        contact = np.where(touching, self.config.contact_weight, 0.0)
        return np.asarray(np.where(gap < 0, self.config.overlap_weight, contact))


def _surface_distance(
    model: ObjectModel, X_SO: Array, points: Array
) -> tuple[Array, Array]:
    """Signed distances (N,) of p_S to an object, and gradients (N, 3) in S."""
    field = registration_model(model).distance_field
    d, g = field.query(transform_points(inverse(X_SO), points))
    return d, g @ X_SO[:3, :3].T


def _jacobian(points: Array, gradients: Array, X_SO: Array) -> Array:
    """Minus the change (N, 6) of fixed points' distance as the object moves.

    The object turns by w about its origin and shifts by v; a fixed point then moves
    by -(w x r + v) relative to it, so its distance d changes by -(r x g . w + g . v).
    """
    r = points - X_SO[:3, 3]
    return np.concatenate([np.cross(r, gradients), gradients], axis=1)


def _geman_mcclure(residual: Array, scale: float) -> Array:
    return np.asarray(1 / np.square(1 + np.square(residual / scale)))


def _damped_solve(equations: _NormalEquations) -> Array:
    """The step that lowers every residual, slightly damped in both kinds of unknown."""
    A, b = equations.A, equations.b
    count = len(b) // 6
    shift = np.tile([0.0, 0.0, 0.0, 1.0, 1.0, 1.0], count)
    scale = max(float(A.diagonal()[shift > 0].mean()), 1e-9)
    damping = np.where(shift > 0, 1e-2, 1e-2 * 0.05**2) * scale
    return np.asarray(np.linalg.solve(A + np.diag(damping), b))
