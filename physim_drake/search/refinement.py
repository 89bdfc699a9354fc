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
from numpy.typing import NDArray

from physim_drake.camera import DepthImage
from physim_drake.compiled import compiled
from physim_drake.objects.model import ObjectModel
from physim_drake.observation.observation import Mask
from physim_drake.poses import Array, exp_pose, inverse, transform_points
from physim_drake.registration.normal_equations import NormalEquations, geman_mcclure
from physim_drake.registration.registration_model import registration_model
from physim_drake.search.states import Placement, StateRenderer

_DAMPING = 1e-2
_MARGIN = 40  # pixels; what is farther off than this pulls at nothing


@dataclass(frozen=True)
class RefinementConfig:
    """Weights and scales of the joint refinement.

    Attributes:
        iterations: number of Gauss-Newton steps.
        redraw_every: iterations after which the silhouettes are drawn anew.
        points_per_object: observed points an object, at most.
        gate_m: a point farther than this from every object counts for none, m.
        residual_scale_m: residuals beyond this lose their pull (Geman-McClure), m.
        cost_cutoff_m: greatest error of a pixel in the fine cost, m.
        see_past_m: the camera saw past a rendered pixel if it measured more than this
            behind it, m.
        silhouette_weight: weight of a pixel seen through, against an observed point.
        overlap_weight: weight of an overlapping surface point.
        contact_weight: weight of a touching surface point.
        contact_gap_m: surfaces nearer than this touch, m.
    """

    iterations: int = 24
    redraw_every: int = 4
    points_per_object: int = 1500
    gate_m: float = 0.015
    residual_scale_m: float = 0.004
    cost_cutoff_m: float = 0.01
    see_past_m: float = 0.006
    silhouette_weight: float = 0.3
    overlap_weight: float = 3.0
    contact_weight: float = 0.3
    contact_gap_m: float = 0.002


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
        self._X_SC = inverse(renderer.scene.X_CS)
        self._masks: dict[tuple[int, ...], Mask] = {}

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
            if iteration % self.config.redraw_every == 0:
                silhouettes = self._silhouettes(poses)
            origins = np.stack([poses[k][:3, 3] for k in indices])
            equations = NormalEquations(origins)
            self._add_points(equations, poses, points)
            self._add_silhouettes(equations, poses, silhouettes)
            self._add_bodies(equations, poses, contacts)
            for k, step in zip(indices, equations.solve(_DAMPING), strict=True):
                D = exp_pose(step)
                poses[k][:3, :3] = D[:3, :3] @ poses[k][:3, :3]
                poses[k][:3, 3] += D[:3, 3]
        return poses

    def fine_cost(self, placed: Placement) -> float:
        """How badly a state explains the image, in pixels; finer than the score C.

        Each rendered pixel costs its depth error, cut at `cost_cutoff_m` and in units
        of it; each pixel of the segments that nothing is rendered in costs 1.
        """
        scene = self._renderer.scene
        image = self._renderer.image(placed)
        mask = self._mask(tuple(placed))
        return float(_fine_cost(image, scene.depth, mask, self.config.cost_cutoff_m))

    def _mask(self, indices: tuple[int, ...]) -> Mask:
        """Pixels of the foreground in the segments of some objects."""
        if indices not in self._masks:
            scene = self._renderer.scene
            masks = [scene.segments[k].mask for k in indices]
            self._masks[indices] = np.logical_or.reduce(masks) & (scene.observed > 0)
        return self._masks[indices]

    def _observed_points(self, indices: Sequence[int]) -> Array:
        """Observed foreground points p_S (N, 3) of the objects' segments."""
        v, u = np.nonzero(self._mask(tuple(indices)))
        limit = self.config.points_per_object * len(indices)
        step = max(1, -(-len(v) // limit))
        v, u = v[::step], u[::step]
        z = self._renderer.scene.observed[v, u].astype(float)
        return self._unprojected(np.stack([u, v], axis=1), z)

    def _add_points(
        self, equations: NormalEquations, poses: Placement, points: Array
    ) -> None:
        found = [
            _surface_distance(self._models[k], X, points) for k, X in poses.items()
        ]
        distances, gradients = (np.stack(part) for part in zip(*found, strict=True))
        gate, scale = self.config.gate_m, self.config.residual_scale_m
        equations.add_nearest(points, distances, gradients, gate, scale)

    def _silhouettes(self, poses: Placement) -> dict[int, tuple[Array, Array]]:
        """What each object hides that the camera saw: p_O, and targets p_S (N, 3).

        The target of a point is its place in the nearest pixel in which the camera did
        not see past it.
        """
        scene = self._renderer.scene
        image, labels = self._renderer.labels(poses)
        rows, columns = self._surroundings(poses)
        image, labels = image[rows, columns], labels[rows, columns]
        depth, observed = scene.depth[rows, columns], scene.observed[rows, columns]
        seen_past = (image > 0) & (depth > image + self.config.see_past_m)
        closed = seen_past | ((image == 0) & (observed == 0) & (depth > 0))
        _, nearest = cv2.distanceTransformWithLabels(
            closed.astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        open_v, open_u = np.nonzero(~closed)
        seeds = np.zeros((nearest.max() + 1, 2), dtype=int)
        seeds[nearest[open_v, open_u]] = np.stack([open_u, open_v], axis=1)
        corner = np.array([columns.start, rows.start])
        result = {}
        for k in poses:
            v, u = np.nonzero((labels == k) & seen_past)
            step = max(1, len(v) // self.config.points_per_object)
            v, u = v[::step], u[::step]
            z = image[v, u].astype(float)
            p_S = self._unprojected(np.stack([u, v], axis=1) + corner, z)
            target_S = self._unprojected(seeds[nearest[v, u]] + corner, z)
            result[k] = (transform_points(inverse(poses[k]), p_S), target_S)
        return result

    def _surroundings(self, poses: Placement) -> tuple[slice, slice]:
        """The rows and columns of the image within which silhouettes matter."""
        windows = [self._renderer.object_window(k, X) for k, X in poses.items()]
        top = min(w.row for w in windows) - _MARGIN
        left = min(w.column for w in windows) - _MARGIN
        bottom = max(w.row + w.depth.shape[0] for w in windows) + _MARGIN
        right = max(w.column + w.depth.shape[1] for w in windows) + _MARGIN
        return slice(max(top, 0), bottom), slice(max(left, 0), right)

    def _unprojected(self, pixels: NDArray[np.int64], z: Array) -> Array:
        """Points p_S (N, 3) at depths (N,), m, in pixels (u, v), (N, 2)."""
        K = self._renderer.scene.intrinsics
        rays = (pixels - [K.cx, K.cy]) / [K.fx, K.fy]
        p_C = np.column_stack([rays * z[:, None], z])
        return transform_points(self._X_SC, p_C)

    def _add_silhouettes(
        self,
        equations: NormalEquations,
        poses: Placement,
        silhouettes: Mapping[int, tuple[Array, Array]],
    ) -> None:
        """Pulls the points seen past sideways, to where the object may be."""
        for n, (k, X) in enumerate(poses.items()):
            points_O, target = silhouettes[k]
            points = transform_points(X, points_O)
            way = target - points
            length = np.linalg.norm(way, axis=1)
            direction = way / np.maximum(length, 1e-9)[:, None]
            weight = self.config.silhouette_weight * geman_mcclure(
                length, 3 * self.config.residual_scale_m
            )
            equations.add(n, points, direction, length, weight)

    def _contacts(self, poses: Placement) -> dict[tuple[int, int], Mask]:
        """Which surface points of i touch j at the start (j = -1: the surface)."""
        touching = {}
        for i, X in poses.items():
            points = transform_points(X, registration_model(self._models[i]).points)
            touching[i, -1] = np.abs(points[:, 2]) < self.config.contact_gap_m
            for j, Y in poses.items():
                if j != i:
                    d, _ = _surface_distance(self._models[j], Y, points)
                    touching[i, j] = np.abs(d) < self.config.contact_gap_m
        return touching

    def _add_bodies(
        self,
        equations: NormalEquations,
        poses: Placement,
        contacts: Mapping[tuple[int, int], Mask],
    ) -> None:
        """Overlap is pushed out, contact kept: with the surface and between objects."""
        for n, (i, X) in enumerate(poses.items()):
            points = transform_points(X, registration_model(self._models[i]).points)
            up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
            weight = self._body_weight(points[:, 2], contacts[i, -1])
            equations.add_between(-1, n, points, up, points[:, 2], weight)
            for m, (j, Y) in enumerate(poses.items()):
                if j != i:
                    d, g = _surface_distance(self._models[j], Y, points)
                    weight = self._body_weight(d, contacts[i, j])
                    equations.add_between(m, n, points, g, d, weight)

    def _body_weight(self, gap: Array, touching: Mask) -> Array:
        contact = np.where(touching, self.config.contact_weight, 0.0)
        return np.asarray(np.where(gap < 0, self.config.overlap_weight, contact))


def _surface_distance(
    model: ObjectModel, X_SO: Array, points: Array
) -> tuple[Array, Array]:
    """Signed distances (N,) of p_S to an object, and gradients (N, 3) in S."""
    return registration_model(model).distance_field.query_posed(X_SO, points)


@compiled()
def _fine_cost(
    image: DepthImage, depth: DepthImage, mask: Mask, cutoff: float
) -> float:
    cost = 0.0
    for v in range(image.shape[0]):
        for u in range(image.shape[1]):
            if image[v, u] == 0:
                cost += mask[v, u]
            elif depth[v, u] > 0:
                cost += min(abs(image[v, u] - depth[v, u]) / cutoff, 1.0)
    return cost
