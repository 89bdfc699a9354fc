# SPDX-License-Identifier: MIT
"""One observation in, the poses of all its objects out: the pipeline in a page."""

from __future__ import annotations

import itertools
import math
import operator
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from types import TracebackType

import numpy as np

from physim_drake.estimate import ObjectEstimate, SceneEstimate, SearchTrace
from physim_drake.hypotheses.generation import PoseHypotheses
from physim_drake.hypotheses.pca import pca_poses
from physim_drake.objects import ObjectLibrary
from physim_drake.observation import Detection, RgbdObservation
from physim_drake.poses import Array, nearest_rotation
from physim_drake.registration import TrimmedIcpConfig, lcp_scores, trimmed_icp
from physim_drake.registration_model import registration_model
from physim_drake.scene import Scene, prepare_scene
from physim_drake.search.dependency import dependency_graph
from physim_drake.search.expansion import Rollout, RolloutResult
from physim_drake.search.states import Placement
from physim_drake.search.tree import (
    GroupSearch,
    SearchConfig,
    SearchResult,
    heuristic_search,
    monte_carlo_tree_search,
)
from physim_drake.surface import (
    SupportSurface,
    find_support_surface,
    surface_at_height,
)
from physim_drake.workers import WorkerConfig, WorkerPool

_NOTHING: Placement = {}


class Method(StrEnum):
    """The ways to estimate a scene.

    The first two search over the scene with physics and refine it; the others take
    each object alone. The last two do the same; but the segments of the last are those
    of a fully convolutional network, wherever a method chooses its detections.
    """

    PHYSIM_MCTS = "physim-mcts"
    PHYSIM_HEURISTIC = "physim-heuristic"
    SUPER4PCS_ICP = "super4pcs-icp"
    PCA_ICP = "pca-icp"
    FCN_PCA_ICP = "fcn-pca-icp"

    @property
    def searches(self) -> bool:
        """Whether it looks at all objects together."""
        return self in (Method.PHYSIM_MCTS, Method.PHYSIM_HEURISTIC)

    @property
    def makes_hypotheses(self) -> bool:
        """Whether it makes pose hypotheses; if not, it takes principal axes."""
        return self not in (Method.PCA_ICP, Method.FCN_PCA_ICP)


@dataclass(frozen=True)
class EstimationConfig:
    """Everything that can be set about an estimate.

    Attributes:
        method: how.
        seed: of all random choices.
        workers: processes; the result does not depend on it.
        search: budget and constants of the tree search.
        steps: settings of the steps that run in workers.
        min_segment_points: an object with fewer points is reported as not found.
        tie: refined states whose fine costs differ by less than this share explain
            the image equally well; the one nearest to rest is taken.
        promising: a state with an object turned over is refined where its fine cost
            exceeds the best state's by less than this share.
        rounds: a group is searched at most this often, with new hypotheses for
            objects that the image does not confirm; 1 is the paper's way.
        confirmed: the confidence from which on an object is.
        trusted: an object of less confidence takes no points from another's new
            hypotheses: where all are wrong together, all begin anew.
    """

    method: Method = Method.PHYSIM_MCTS
    seed: int = 0
    workers: int = 1
    search: SearchConfig = field(default_factory=SearchConfig)
    steps: WorkerConfig = field(default_factory=WorkerConfig)
    min_segment_points: int = 30
    tie: float = 0.01
    promising: float = 0.1
    rounds: int = 3
    confirmed: float = 0.93
    trusted: float = 0.7

    def with_budget(self, expansions: int, representatives: int) -> EstimationConfig:
        """The same with other sizes of the search and of the hypotheses' sets."""
        steps = self.steps
        clustering = replace(
            steps.hypotheses.clustering, representatives=representatives
        )
        hypotheses = replace(steps.hypotheses, clustering=clustering)
        return replace(
            self,
            search=replace(self.search, expansions=expansions),
            steps=replace(steps, hypotheses=hypotheses),
        )


class PoseEstimator:
    """Estimates scenes; keeps its workers warm from one image to the next.

    Args:
        library: the objects that may occur.
        config: method and settings.

    Use it as a context manager, or call `close`.
    """

    def __init__(
        self,
        library: ObjectLibrary,
        config: EstimationConfig = EstimationConfig(),
    ) -> None:
        self._library, self._config = library, config
        self._pool = WorkerPool(library, config.steps, config.workers)
        self._prepared: tuple[tuple[object, ...], SupportSurface, Scene] | None = None

    def estimate(
        self,
        observation: RgbdObservation,
        detections: Sequence[Detection],
        surface_height: float | None = None,
        hypotheses: Sequence[PoseHypotheses] | None = None,
    ) -> SceneEstimate:
        """Estimates the pose of every detected object.

        Args:
            observation: the image.
            detections: one for each object to find; one that the detector did not see
                (`Detection.unseen`) is not found.
            surface_height: z of the support surface in the world, m; found in the
                image if not given.
            hypotheses: what the method of that name returned for the same arguments,
                one for each detection; made here if not given.

        Raises:
            InputError: where the surface cannot be found, or an object has no model.
        """
        clock = _StageClock()
        surface, scene = self._prepare(observation, detections, surface_height)
        clock.lap("segments")
        self._pool.set_scene(scene)
        clock.lap("setup")
        large = [
            k
            for k, segment in enumerate(scene.segments)
            if len(segment.points) >= self._config.min_segment_points
        ]
        found: dict[int, PoseHypotheses] = {}
        if hypotheses is not None:
            given = zip(detections, hypotheses, strict=True)
            found = {
                k: h for k, (_, h) in enumerate(given) if k in large and len(h.X_SO)
            }
        elif self._config.method.makes_hypotheses:
            found = self._hypotheses([(k, _NOTHING) for k in large], 0)
        clock.lap("hypotheses")
        trace: list[SearchTrace] = []
        if self._config.method.searches:
            placed = self._search(scene, found, clock, trace)
        else:
            placed = self._register(scene, large, found)
            clock.lap("hypotheses")
        confidences = self._pool.map("confidences", [(placed,)])[0]
        clock.lap("refinement")
        objects = tuple(
            self._object_estimate(
                observation, scene, surface.X_WS, k, placed, confidences
            )
            for k in range(len(detections))
        )
        return SceneEstimate(
            objects, surface, str(self._config.method), clock.stages, tuple(trace)
        )

    def hypotheses(
        self,
        observation: RgbdObservation,
        detections: Sequence[Detection],
        surface_height: float | None = None,
    ) -> tuple[Scene, list[PoseHypotheses]]:
        """The pose hypotheses of each detected object, as `estimate` makes them first.

        The arguments are those of `estimate`; the poses are in the frame S of the
        scene that is returned, too.
        """
        _, scene = self._prepare(observation, detections, surface_height)
        self._pool.set_scene(scene)
        seed = self._config.seed
        requests = [(k, _NOTHING, (seed, 0, k)) for k in range(len(detections))]
        return scene, self._pool.map("hypotheses", requests)

    def _prepare(
        self,
        observation: RgbdObservation,
        detections: Sequence[Detection],
        surface_height: float | None,
    ) -> tuple[SupportSurface, Scene]:
        # `estimate` often follows `hypotheses` with the very same objects.
        key = (observation, *detections, surface_height)
        if self._prepared is not None and _same(self._prepared[0], key):
            return self._prepared[1:]
        if surface_height is None:
            generator = np.random.default_rng(self._config.seed)
            seen = [d for d in detections if d.seen]
            surface = find_support_surface(observation, seen, generator)
        else:
            surface = surface_at_height(observation, surface_height)
        self._prepared = key, surface, prepare_scene(observation, surface, detections)
        return self._prepared[1:]

    def close(self) -> None:
        """Ends the workers."""
        self._pool.close()

    def __enter__(self) -> PoseEstimator:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _hypotheses(
        self, requests: Sequence[tuple[int, Placement]], number: int
    ) -> dict[int, PoseHypotheses]:
        """Hypotheses of objects, from their points less what others explain."""
        found = self._pool.map(
            "hypotheses",
            [(k, others, (self._config.seed, number, k)) for k, others in requests],
        )
        return {k: h for (k, _), h in zip(requests, found, strict=True) if len(h.X_SO)}

    def _search(
        self,
        scene: Scene,
        found: Mapping[int, PoseHypotheses],
        clock: _StageClock,
        trace: list[SearchTrace],
    ) -> dict[int, Array]:
        """Searches each independent group, refines its best states, joins them."""
        placed: dict[int, Array] = {}
        groups = dependency_graph(scene.segments, scene.X_CS).components
        for component in groups:
            order = tuple(k for k in component if k in found)
            if order:
                hypotheses = {k: found[k].poses for k in order}
                placed |= self._search_group(scene, order, hypotheses, clock, trace)
        if len(groups) > 1 and placed:
            placed = self._pool.map("refine", [(placed,)])[0][0]
        clock.lap("refinement")
        return placed

    def _search_group(
        self,
        scene: Scene,
        order: Sequence[int],
        hypotheses: dict[int, Array],
        clock: _StageClock,
        trace: list[SearchTrace],
    ) -> dict[int, Array]:
        """The best refined state of one group.

        An object that the image does not confirm gets new hypotheses, from those of
        its points that better confirmed objects do not explain, and the group is
        searched again with these, best confirmed objects first; the confirmed ones
        keep their poses.
        """
        best: dict[int, Array] = {}
        best_cost = math.inf
        for number in range(self._config.rounds):
            result = self._run_search(order, hypotheses, number)
            clock.lap("search")
            trace.append(SearchTrace.of(result, scene))
            states = [
                dict(zip(result.order, state.poses, strict=True))
                for state in result.states
            ]
            refined = self._pool.map("refine", [(state,) for state in states])
            clock.lap("refinement")
            state, cost = self._turned_over(*self._most_plausible(refined))
            if cost < best_cost:
                best, best_cost = state, cost
            confidence = self._pool.map("confidences", [(best,)])[0]
            doubtful = [k for k in order if confidence[k] < self._config.confirmed]
            if not doubtful or number + 1 == self._config.rounds:
                break
            order = sorted(order, key=lambda k: -confidence[k])
            again = self._hypotheses(
                [
                    (
                        k,
                        {
                            j: best[j]
                            for j in order
                            if confidence[j] > max(confidence[k], self._config.trusted)
                        },
                    )
                    for k in doubtful
                ],
                number + 1,
            )
            clock.lap("hypotheses")
            hypotheses = {
                k: np.concatenate([best[k][None], again[k].poses])
                if k in again
                else best[k][None]
                for k in order
            }
        return best

    def _most_plausible(
        self, refined: Sequence[tuple[dict[int, Array], float]]
    ) -> tuple[dict[int, Array], float]:
        """The state of least fine cost; physics decides where that hardly differs.

        What hides of an object may fit the image in several ways, but not all of them
        carry what lies on it.
        """
        least = min(cost for _, cost in refined)
        tied = [r for r in refined if r[1] <= least * (1 + self._config.tie)]
        if len(tied) == 1:
            return tied[0]
        unrest = self._pool.map("unrest", [(state,) for state, _ in tied])
        return tied[int(np.argmin(unrest))]

    def _turned_over(
        self, state: dict[int, Array], cost: float
    ) -> tuple[dict[int, Array], float]:
        """The state with objects turned over where that explains the image better.

        One at a time, as long as the fine cost falls by more than a tie's share.
        """
        while True:
            found = self._pool.map("turned", [(state, k) for k in state])
            promising = [
                turned
                for turned, turned_cost in itertools.chain.from_iterable(found)
                if turned_cost < cost * (1 + self._config.promising)
            ]
            refined = self._pool.map("refine", [(turned,) for turned in promising])
            least = min(refined, key=lambda r: r[1], default=(state, cost))
            if least[1] >= cost * (1 - self._config.tie):
                return state, cost
            state, cost = least

    def _run_search(
        self, order: Sequence[int], hypotheses: Mapping[int, Array], number: int
    ) -> SearchResult:
        def run(rollouts: Sequence[Rollout]) -> list[RolloutResult]:
            return self._pool.map("rollout", [(rollout,) for rollout in rollouts])

        search = GroupSearch(
            order, [hypotheses[k] for k in order], run, self._config.search
        )
        if self._config.method is Method.PHYSIM_HEURISTIC:
            return heuristic_search(search)
        generator = np.random.default_rng([self._config.seed, number, *order])
        return monte_carlo_tree_search(search, generator)

    def _register(
        self,
        scene: Scene,
        large: Sequence[int],
        found: Mapping[int, PoseHypotheses],
    ) -> dict[int, Array]:
        """Each object alone: its best hypothesis or principal axes, then ICP."""
        if self._config.method is Method.SUPER4PCS_ICP:
            starts = {k: h.X_SO[[int(h.lcp.argmax())]] for k, h in found.items()}
        else:
            starts = {
                k: pca_poses(self._library[scene.object_ids[k]], scene.segments[k])
                for k in large
            }
        placed = {}
        for k, X_SO in starts.items():
            segment = scene.segments[k]
            field_O = registration_model(
                self._library[segment.object_id]
            ).distance_field
            aligned, _ = trimmed_icp(
                field_O,
                X_SO,
                segment.points,
                segment.normals,
                TrimmedIcpConfig(keep=0.9),
            )
            scores = lcp_scores(
                field_O, aligned, segment.points, segment.normals, 0.005
            )
            placed[k] = aligned[int(scores.argmax())]
        return placed

    def _object_estimate(
        self,
        observation: RgbdObservation,
        scene: Scene,
        X_WS: Array,
        k: int,
        placed: Mapping[int, Array],
        confidences: Mapping[int, float],
    ) -> ObjectEstimate:
        segment = scene.segments[k]
        name = self._library[segment.object_id].name
        if k not in placed:
            count, least = len(segment.points), self._config.min_segment_points
            reason = (
                f"its segment has {count} points, at least {least} are needed"
                if count < least
                else "no pose of it fits its segment"
            )
            if not segment.detection.seen:
                reason = "the detector did not see it"
            return ObjectEstimate(segment.object_id, name, None, None, 0.0, reason)
        X_SO = placed[k].copy()
        X_SO[:3, :3] = nearest_rotation(X_SO[:3, :3])
        X_CO = scene.X_CS @ X_SO
        X_WO = X_WS @ X_SO if observation.X_WC is None else observation.X_WC @ X_CO
        return ObjectEstimate(segment.object_id, name, X_CO, X_WO, confidences[k], "")


def estimate_scene(
    observation: RgbdObservation,
    library: ObjectLibrary,
    detections: Sequence[Detection],
    config: EstimationConfig = EstimationConfig(),
    surface_height: float | None = None,
) -> SceneEstimate:
    """Estimates one scene; for many, keep a `PoseEstimator`.

    Args:
        observation: the image.
        library: models of the objects.
        detections: one for each object to find.
        config: method and settings.
        surface_height: z of the support surface in the world, m; found if not given.

    Raises:
        InputError: where the surface cannot be found, or an object has no model.
    """
    with PoseEstimator(library, config) as estimator:
        return estimator.estimate(observation, detections, surface_height)


def _same(one: Sequence[object], other: Sequence[object]) -> bool:
    """Whether two sequences hold the very same objects."""
    return len(one) == len(other) and all(map(operator.is_, one, other))


class _StageClock:
    """Seconds spent in each stage."""

    def __init__(self) -> None:
        self.stages: dict[str, float] = {}
        self._last = time.monotonic()

    def lap(self, stage: str) -> None:
        """Books the time since the last lap under `stage`."""
        now = time.monotonic()
        self.stages[stage] = self.stages.get(stage, 0.0) + now - self._last
        self._last = now
