# SPDX-License-Identifier: MIT
"""From hypotheses to the best refined state of a scene, group by independent group."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from physim_drake.estimation.config import EstimationConfig
from physim_drake.estimation.group_estimator import GroupEstimator, SearchedGroup
from physim_drake.estimation.stage_clock import StageClock
from physim_drake.estimation.workers import Worker, WorkerPool
from physim_drake.hypotheses.generation import PoseHypotheses
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.segmented_scene import SegmentedScene
from physim_drake.poses import Array
from physim_drake.scene_estimate import SearchTrace
from physim_drake.search.dependency import dependency_graph
from physim_drake.search.record import SearchRecord


@dataclass(frozen=True)
class SearchedScene:
    """What was found of a scene; objects go by their index in it.

    Attributes:
        placed: X_SO of each object that was found.
        shares: the share of its confidence that each of them keeps: less than 1 if
            another pose explains the image about as well.
        excluded: objects that were left out, because the image does not confirm them,
            and confirms others more without them.
        traces: the anytime curve of each search of a group.
    """

    placed: dict[int, Array]
    shares: dict[int, float] = field(default_factory=dict)
    excluded: frozenset[int] = frozenset()
    traces: tuple[SearchTrace, ...] = ()


class SceneSearch:
    """Searches one scene.

    Args:
        scene: the scene, which the pool's workers have already.
        library: models of its objects.
        pool: workers that do the computing.
        config: settings of the search.
        clock: books the seconds of each stage.
        on_search: hears of each search of a group when it is done.
    """

    def __init__(
        self,
        scene: SegmentedScene,
        library: ObjectLibrary,
        pool: WorkerPool,
        config: EstimationConfig,
        clock: StageClock,
        on_search: Callable[[SearchRecord], None] | None = None,
    ) -> None:
        self._scene, self._pool = scene, pool
        self._config, self._clock = config, clock
        self._estimator = GroupEstimator(scene, library, pool, config, clock, on_search)
        self._groups: dict[tuple[int, ...], SearchedGroup] = {}  # searched so far

    def run(self, found: Mapping[int, PoseHypotheses]) -> SearchedScene:
        """The best state of the scene.

        Args:
            found: hypotheses of the objects, by their index in the scene.
        """
        hypotheses = {k: h.poses for k, h in found.items()}
        placed, shares = self._place(hypotheses)
        confidence = self._pool.one(Worker.confidences, placed)
        suspects = self._suspects(confidence)
        while suspects:
            k = suspects.pop(0)
            rest = {j: poses for j, poses in hypotheses.items() if j != k}
            others, their_shares = self._place(rest)
            confirmed = self._pool.one(Worker.confidences, others)
            if sum(confirmed.values()) > sum(confidence[j] for j in rest):
                hypotheses, placed, confidence = rest, others, confirmed
                shares = their_shares
                suspects = self._suspects(confidence)
        self._clock.lap("refinement")
        traces = [t for group in self._groups.values() for t in group.traces]
        excluded = frozenset(found.keys() - hypotheses.keys())
        return SearchedScene(placed, shares, excluded, tuple(traces))

    def _suspects(self, confidence: Mapping[int, float]) -> list[int]:
        """Objects that may cost others their poses: the two least confirmed, if absent.

        An object that is not there is still put somewhere. There it takes points from
        others or pushes them away.
        """
        doubtful = [k for k, c in confidence.items() if c < self._config.confident_from]
        if len(doubtful) < 2:
            return []
        least = sorted(doubtful, key=lambda k: confidence[k])[:2]
        return [k for k in least if confidence[k] < self._config.required_confidence]

    def _place(
        self, hypotheses: Mapping[int, Array]
    ) -> tuple[dict[int, Array], dict[int, float]]:
        """The best state of these objects, and their shares of confidence.

        A group that was searched before is not searched again.
        """
        placed: dict[int, Array] = {}
        shares: dict[int, float] = {}
        scene = self._scene
        groups = dependency_graph(scene.segments, scene.X_CS).components
        for component in groups:
            order = tuple(k for k in component if k in hypotheses)
            if not order:
                continue
            if order not in self._groups:
                self._groups[order] = self._estimator.estimate(order, hypotheses)
            placed |= self._groups[order].placed
            shares |= self._groups[order].shares
        if len(groups) > 1 and placed:
            placed = self._pool.one(Worker.refine, placed)[0]
        return placed, shares
