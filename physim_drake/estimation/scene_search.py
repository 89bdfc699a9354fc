# SPDX-License-Identifier: MIT
"""From hypotheses to the best refined state of a scene, group by independent group.

Each group is searched, its best states are refined and compared on every pixel, and
what the image then does not confirm is searched again with new hypotheses.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from physim_drake.estimation.ambiguity import confidence_shares
from physim_drake.estimation.config import EstimationConfig, Method
from physim_drake.estimation.workers import Worker, WorkerPool
from physim_drake.hypotheses.generation import PoseHypotheses
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.segmented_scene import Scene
from physim_drake.poses import Array
from physim_drake.scene_estimate import SearchTrace
from physim_drake.search.dependency import dependency_graph
from physim_drake.search.expansion import Rollout, RolloutResult
from physim_drake.search.states import Placement
from physim_drake.search.tree import (
    GroupSearch,
    SearchResult,
    heuristic_search,
    monte_carlo_tree_search,
)

CostedState = tuple[dict[int, Array], float]
"""X_SO of objects by their index in the scene, and the state's fine cost in pixels."""


class StageClock:
    """Seconds spent in each stage."""

    def __init__(self) -> None:
        self.stages: dict[str, float] = {}
        self._last = time.monotonic()

    def lap(self, stage: str) -> None:
        """Books the time since the last lap under `stage`."""
        now = time.monotonic()
        self.stages[stage] = self.stages.get(stage, 0.0) + now - self._last
        self._last = now


class SceneSearch:
    """Searches one scene.

    Args:
        scene: the scene, which the pool's workers have already.
        library: models of its objects.
        pool: does the computing.
        config: of the search.
        clock: is told which stage takes how long.

    Attributes:
        trace: the anytime curve of each search of a group.
        shares: the share of its confidence that each object keeps, by its index in the
            scene: less than 1 where another pose explains the image about as well.
        in_the_way: objects that were left out, because the image does not confirm them,
            and confirms others more without them.
    """

    def __init__(
        self,
        scene: Scene,
        library: ObjectLibrary,
        pool: WorkerPool,
        config: EstimationConfig,
        clock: StageClock,
    ) -> None:
        self._scene, self._pool = scene, pool
        self._config, self._clock = config, clock
        self._models = {k: library[i] for k, i in enumerate(scene.object_ids)}
        self.trace: list[SearchTrace] = []
        self.shares: dict[int, float] = {}
        self.in_the_way: set[int] = set()
        self._searched: dict[
            tuple[int, ...], tuple[dict[int, Array], dict[int, float]]
        ] = {}

    def run(self, found: Mapping[int, PoseHypotheses]) -> dict[int, Array]:
        """The best state of the scene.

        Args:
            found: hypotheses of the objects, by their index in the scene.

        Returns:
            X_SO of each of these objects but those in the way of others.
        """
        hypotheses = {k: h.poses for k, h in found.items()}
        placed, self.shares = self._place(hypotheses)
        confidence = self._confidences(placed)
        suspects = self._suspects(confidence)
        while suspects:
            k = suspects.pop(0)
            rest = {j: poses for j, poses in hypotheses.items() if j != k}
            others, shares = self._place(rest)
            confirmed = self._confidences(others)
            if sum(confirmed.values()) > sum(confidence[j] for j in rest):
                self.in_the_way.add(k)
                hypotheses, placed, confidence = rest, others, confirmed
                self.shares = shares
                suspects = self._suspects(confidence)
        self._clock.lap("refinement")
        return placed

    def _suspects(self, confidence: Mapping[int, float]) -> list[int]:
        """Objects that may cost others their poses: the two least confirmed, if absent.

        An object that is not there has to be put somewhere all the same, where it takes
        points from others or pushes them away.
        """
        doubtful = [k for k, c in confidence.items() if c < self._config.confirmed]
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
            if order and order not in self._searched:
                self._searched[order] = self._search_group(order, hypotheses)
            if order:
                placed |= self._searched[order][0]
                shares |= self._searched[order][1]
        if len(groups) > 1 and placed:
            placed = self._pool.one(Worker.refine, placed)[0]
        return placed, shares

    def _confidences(self, placed: Placement) -> dict[int, float]:
        """How well the image confirms each object of a state, 0..1."""
        return self._pool.one(Worker.confidences, placed)

    def _search_group(
        self, order: Sequence[int], hypotheses: Mapping[int, Array]
    ) -> tuple[dict[int, Array], dict[int, float]]:
        """The best refined state of one group, and its shares of confidence.

        An object that the image does not confirm gets new hypotheses, from those of
        its points that better confirmed objects do not explain, and the group is
        searched again with these, best confirmed objects first; the confirmed ones
        keep their poses. That ends where it gains nothing, unless an object is as good
        as lost.
        """
        best: dict[int, Array] = {}
        best_cost = math.inf
        tried: list[CostedState] = []
        for number in range(self._config.rounds):
            result = self._run_search(order, hypotheses, number)
            self._clock.lap("search")
            self.trace.append(result.as_trace(self._scene.X_CS))
            states = [
                dict(zip(result.order, state.poses, strict=True))
                for state in result.states
            ]
            refined = self._pool.map(Worker.refine, [(state,) for state in states])
            self._clock.lap("refinement")
            tried += refined
            state, cost = self._most_plausible(refined)
            state, cost = self._other_ways(state, cost, hypotheses, tried)
            gained = cost < best_cost * (1 - self._config.tie)
            if cost < best_cost:
                best, best_cost = state, cost
            confidence = self._confidences(best)
            doubtful = [k for k in order if confidence[k] < self._config.confirmed]
            lost = [k for k in doubtful if confidence[k] < self._config.trusted]
            worth_it = lost or (doubtful and gained)
            if not worth_it or number + 1 == self._config.rounds:
                break
            order = sorted(order, key=lambda k: -confidence[k])
            hypotheses = self._renewed(order, doubtful, best, confidence, number + 1)
        shares = confidence_shares(
            best, best_cost, tried, self._models, self._config.tie
        )
        return best, shares

    def _renewed(
        self,
        order: Sequence[int],
        doubtful: Sequence[int],
        best: Mapping[int, Array],
        confidence: Mapping[int, float],
        number: int,
    ) -> dict[int, Array]:
        """The poses to search among in round `number`, new ones of doubtful objects."""
        requests = []
        for k in doubtful:
            least = max(confidence[k], self._config.trusted)
            requests.append((k, {j: best[j] for j in order if confidence[j] > least}))
        again = make_hypotheses(self._pool, self._config, requests, number)
        self._clock.lap("hypotheses")
        return {
            k: np.concatenate([best[k][None], again[k].poses])
            if k in again
            else best[k][None]
            for k in order
        }

    def _most_plausible(self, refined: Sequence[CostedState]) -> CostedState:
        """The state of least fine cost; physics decides where that hardly differs.

        What hides of an object may fit the image in several ways, but not all of them
        carry what lies on it.
        """
        least = min(cost for _, cost in refined)
        tied = [r for r in refined if r[1] <= least * (1 + self._config.tie)]
        if len(tied) == 1:
            return tied[0]
        unrest = self._pool.map(Worker.unrest, [(state,) for state, _ in tied])
        beyond = np.maximum(unrest, self._config.rest)
        return min(zip(beyond, tied, strict=True), key=lambda r: (r[0], r[1][1]))[1]

    def _other_ways(
        self,
        state: dict[int, Array],
        cost: float,
        hypotheses: Mapping[int, Array],
        tried: list[CostedState],
    ) -> CostedState:
        """The state with objects in other poses where those explain the image better.

        One at a time, each object is turned over and put at each of its hypotheses
        among the others as they are: the search need not have tried the other ways in
        which an object that hardly shows fits the image. It stays as it was found where
        the fine cost falls by less than a tie's share. What is refined for it is added
        to `tried`.
        """
        while True:
            ways = self._pool.map(
                Worker.other_ways, [(state, k, hypotheses[k]) for k in state]
            )
            promising = [
                way
                for way, way_cost in itertools.chain.from_iterable(ways)
                if way_cost < cost * (1 + self._config.promising)
            ]
            refined = self._pool.map(Worker.refine, [(way,) for way in promising])
            tried += refined
            least = min(refined, key=lambda r: r[1], default=(state, cost))
            if least[1] >= cost * (1 - self._config.tie):
                return state, cost
            state, cost = least

    def _run_search(
        self, order: Sequence[int], hypotheses: Mapping[int, Array], number: int
    ) -> SearchResult:
        def run(rollouts: Sequence[Rollout]) -> list[RolloutResult]:
            """The results, in the order of the rollouts."""
            # The longest first, so that no worker waits long for another's last one.
            longest = sorted(enumerate(rollouts), key=lambda item: -len(item[1].steps))
            results = self._pool.map(
                Worker.rollout, [(rollout,) for _, rollout in longest]
            )
            by_number = {n: r for (n, _), r in zip(longest, results, strict=True)}
            return [by_number[n] for n in range(len(rollouts))]

        config = self._config.search
        if number > 0:  # what is doubtful is worth all expansions
            config = replace(config, patience=math.inf)
        search = GroupSearch(order, [hypotheses[k] for k in order], run, config)
        if self._config.method is Method.PHYSIM_HEURISTIC:
            return heuristic_search(search)
        generator = np.random.default_rng([self._config.seed, number, *order])
        return monte_carlo_tree_search(search, generator)


def make_hypotheses(
    pool: WorkerPool,
    config: EstimationConfig,
    requests: Sequence[tuple[int, Placement]],
    number: int,
) -> dict[int, PoseHypotheses]:
    """Hypotheses of objects, from their points less what others explain.

    Args:
        pool: does the computing.
        config: gives the seed.
        requests: index of each object, and the poses of the others.
        number: of the round; each draws other random numbers.

    Returns:
        those of objects that any pose fits.
    """
    found = pool.map(
        Worker.hypotheses,
        [(k, others, (config.seed, number, k)) for k, others in requests],
    )
    return {k: h for (k, _), h in zip(requests, found, strict=True) if len(h.X_SO)}
