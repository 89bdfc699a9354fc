# SPDX-License-Identifier: MIT
"""Algorithm 2 of the paper: place one more object, consistent with those placed.

Re-segment, align by trimmed ICP, settle by physics, in that order; then draw and score.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from physim_drake.objects.model import ObjectModel
from physim_drake.observation.segmented_scene import SegmentedScene
from physim_drake.physics.depenetration import depenetrate
from physim_drake.physics.settling import Settled, Settler
from physim_drake.poses import Array, rotation_angle
from physim_drake.registration.registration_model import (
    lookalike_turns,
    registration_model,
)
from physim_drake.registration.trimmed_icp import trimmed_icp
from physim_drake.rendering.windows import ObjectRenderer
from physim_drake.search.dependency import dependency_graph
from physim_drake.search.states import (
    ExpansionConfig,
    Placement,
    StateRenderer,
)


@dataclass(frozen=True)
class Rollout:
    """A request: from a state, place these objects at these hypotheses, in order.

    Attributes:
        placed: the state's objects.
        steps: (index, hypothesis X_SO) of each object to add.
    """

    placed: tuple[tuple[int, Array], ...]
    steps: tuple[tuple[int, Array], ...]


@dataclass(frozen=True)
class RolloutResult:
    """What came of a `Rollout`.

    Attributes:
        poses: X_SO of each added object after alignment and settling.
        score: C of the final state.
        intruding: number of its pixels that stand before what the camera saw.
    """

    poses: tuple[Array, ...]
    score: int
    intruding: int = 0


class SceneExpander:
    """Runs expansions of one scene; holds its renderer and its plants.

    Args:
        scene: the image to explain.
        models: the objects, by id.
        renderer: draws them.
        config: thresholds of the three steps.
    """

    def __init__(
        self,
        scene: SegmentedScene,
        models: Mapping[int, ObjectModel],
        renderer: ObjectRenderer,
        config: ExpansionConfig = ExpansionConfig(),  # noqa: B008 (frozen)
    ) -> None:
        self.scene = scene
        self._config = config
        self.models = [models[object_id] for object_id in scene.object_ids]
        self.renderer = StateRenderer(scene, renderer, config.depth_tolerance_m)
        self._settlers: dict[int, Settler] = {}
        # Only those of a group ever settle together; others would fill the memory.
        self._beside = {
            k: sorted(set(group) - {k})
            for group in dependency_graph(scene.segments, scene.X_CS).components
            for k in group
        }
        self._clouds = [self._thinned(k) for k in range(len(scene.segments))]

    def run(self, rollout: Rollout) -> RolloutResult:
        """Places the rollout's objects one after the other and scores the end."""
        placed = dict(rollout.placed)
        for index, X_SO in rollout.steps:
            placed[index] = self.expand(placed, index, X_SO)
        image = self.renderer.image(placed)
        return RolloutResult(
            tuple(placed[index] for index, _ in rollout.steps),
            self.renderer.score(image),
            self.renderer.intruding(image),
        )

    def expand(self, placed: Placement, index: int, X_SO: Array) -> Array:
        """The pose an object takes, from a hypothesis, among those placed.

        Returns:
            X_SO (4, 4); an object that leaves the scene stays as it was aligned.
        """
        config = self._config
        points, normals = self.resegment(placed, index)
        field = registration_model(self.models[index]).distance_field
        aligned = trimmed_icp(field, X_SO[None], points, normals, config.icp)[0][0]
        freed = depenetrate(
            self.models[index],
            aligned,
            [(self.models[k], X) for k, X in placed.items()],
        )
        if not self.scene.supported:
            return freed
        settled = self._settle(index, freed, placed)
        if settled.lost:
            return freed
        return self._supported(placed, index, freed, settled.X_SO)

    def other_ways(self, placed: Placement, index: int, poses: Array) -> Array:
        """Other poses of one object among the others, aligned to its points anew.

        Args:
            placed: the state, with the object.
            index: index of the object.
            poses: X_SO (N, 4, 4) to begin at. It is also turned over by each motion
                that maps it nearly onto itself: a bottle on its cap looks much like
                one on its base.

        Returns:
            X_SO (M, 4, 4), M >= N.
        """
        model = self.models[index]
        starts = np.concatenate([placed[index] @ lookalike_turns(model), poses])
        others = {k: X for k, X in placed.items() if k != index}
        points, normals = self.resegment(others, index)
        field = registration_model(model).distance_field
        return trimmed_icp(field, starts, points, normals, self._config.icp)[0]

    def unrest(self, placed: Placement) -> float:
        """How far a state is from resting: the farthest that an object settles, m.

        Each object settles alone among the others; what counts is how far any point
        of it can have moved. Without a surface, every state is at rest.
        """
        farthest = 0.0
        if not self.scene.supported:
            return farthest
        for index, X_SO in placed.items():
            settled = self._settle(index, X_SO, placed)
            if settled.lost:
                return math.inf
            shift = float(np.linalg.norm(settled.X_SO[:3, 3] - X_SO[:3, 3]))
            turn = rotation_angle(settled.X_SO[:3, :3].T @ X_SO[:3, :3])
            radius = self.models[index].diameter / 2
            farthest = max(farthest, shift + float(turn) * radius)
        return farthest

    def resegment(self, placed: Placement, index: int) -> tuple[Array, Array]:
        """The object's points and normals (N, 3), less what placed objects explain."""
        points, normals = self._clouds[index]
        left = np.ones(len(points), dtype=bool)
        for k, X_SO in placed.items():
            field = registration_model(self.models[k]).distance_field
            distances, _ = field.query_posed(X_SO, points)
            left &= np.abs(distances) > self._config.resegment_distance_m
        if left.sum() < self._config.min_points:
            return points, normals
        return points[left], normals[left]

    def _supported(
        self, placed: Placement, index: int, freed: Array, settled: Array
    ) -> Array:
        """The settled pose, unless it explains clearly less than before settling."""
        moved = np.linalg.norm(settled[:3, 3] - freed[:3, 3])
        turned = np.abs(settled[:3, :3] - freed[:3, :3]).max()
        if moved < 0.002 and turned < 0.02:
            return settled
        parent = self.renderer.image(placed)
        gains = [self.renderer.gain(parent, index, X) for X in (freed, settled)]
        keep = gains[1] >= gains[0] - self._config.settle_loss_fraction * abs(gains[0])
        return settled if keep else freed

    def _settle(self, index: int, X_SO: Array, placed: Placement) -> Settled:
        """Where an object comes to rest among the others that are placed."""
        others = {k: X for k, X in placed.items() if k != index}
        if not others.keys() <= set(self._beside[index]):  # not asked for by a search
            self._beside[index] = [k for k in range(len(self.models)) if k != index]
            self._settlers.pop(index, None)
        beside = self._beside[index]
        if index not in self._settlers:
            models = [self.models[k] for k in beside]
            self._settlers[index] = Settler(
                self.models[index], models, self._config.settle
            )
        return self._settlers[index].settle(
            X_SO, {beside.index(k): X for k, X in others.items()}
        )

    def _thinned(self, index: int) -> tuple[Array, Array]:
        """Evenly spread points of a segment, few enough to align quickly."""
        segment, count = self.scene.segments[index], self._config.icp_points
        n = len(segment.points)
        if n <= count:
            return segment.points, segment.normals
        keep = np.random.default_rng(index).choice(n, count, replace=False)
        return segment.points[np.sort(keep)], segment.normals[np.sort(keep)]
