# SPDX-License-Identifier: MIT
"""From hypotheses to the best refined state of one group of objects, in rounds.

A group is searched, its best states are refined and compared on every pixel, and what
the image then does not confirm is searched again with new hypotheses.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from physim_drake.estimation.ambiguity import confidence_shares
from physim_drake.estimation.config import EstimationConfig, Method
from physim_drake.estimation.stage_clock import StageClock
from physim_drake.estimation.workers import Worker, WorkerPool
from physim_drake.hypotheses.generation import PoseHypotheses
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.segmented_scene import SegmentedScene
from physim_drake.poses import Array
from physim_drake.scene_estimate import SearchTrace
from physim_drake.search.expansion import Rollout, RolloutResult
from physim_drake.search.group_search import GroupSearch, SearchResult, Selection
from physim_drake.search.record import SearchRecord
from physim_drake.search.states import Placement
from physim_drake.search.tree import heuristic_search, monte_carlo_tree_search

CostedState = tuple[dict[int, Array], float]
"""X_SO of objects by their index in the scene, and the state's fine cost in pixels."""


@dataclass(frozen=True)
class SearchedGroup:
    """What was found of one group.

    Attributes:
        placed: X_SO of each object, by its index in the scene.
        shares: the share of its confidence that each object keeps: less than 1 if
            another pose explains the image about as well.
        traces: the anytime curve of each round's search.
    """

    placed: dict[int, Array]
    shares: dict[int, float]
    traces: tuple[SearchTrace, ...]


class GroupEstimator:
    """Estimates the groups of one scene, one after the other.

    Args:
        scene: the scene, which the pool's workers have already.
        library: models of its objects.
        pool: workers that do the computing.
        config: settings of the search.
        clock: books the seconds of each stage.
        on_search: hears of each search when it is done.
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
        self._scene, self._pool, self._on_search = scene, pool, on_search
        self._config, self._clock = config, clock
        self._models = {k: library[i] for k, i in enumerate(scene.object_ids)}

    def estimate(
        self, order: Sequence[int], hypotheses: Mapping[int, Array]
    ) -> SearchedGroup:
        """The best refined state of one group.

        An object that the image does not confirm gets new hypotheses, from those of
        its points that better confirmed objects do not explain, and the group is
        searched again with these, best confirmed objects first; the confirmed ones
        keep their poses. That ends when it gains nothing, unless an object is as good
        as lost.

        Args:
            order: indices of the group's objects, in placing order.
            hypotheses: X_SO (K, 4, 4) of each of them, best LCP first.
        """
        best: dict[int, Array] = {}
        best_cost = math.inf
        tried: list[CostedState] = []
        traces: list[SearchTrace] = []
        for number in range(self._config.rounds):
            result = self._search(order, hypotheses, number)
            self._clock.lap("search")
            traces.append(result.as_trace(self._scene.X_CS))
            state, cost = self._refined(result, hypotheses, tried)
            gained = cost < best_cost * (1 - self._config.cost_tie_fraction)
            if cost < best_cost:
                best, best_cost = state, cost
            confidence = self._pool.one(Worker.confidences, best)
            doubtful = [k for k in order if confidence[k] < self._config.confident_from]
            lost = [k for k in doubtful if confidence[k] < self._config.trusted_from]
            worth_it = lost or (doubtful and gained)
            if not worth_it or number + 1 == self._config.rounds:
                break
            order = sorted(order, key=lambda k: -confidence[k])
            hypotheses = self._renewed(order, doubtful, best, confidence, number + 1)
        shares = confidence_shares(
            best, best_cost, tried, self._models, self._config.cost_tie_fraction
        )
        return SearchedGroup(best, shares, tuple(traces))

    def _refined(
        self,
        result: SearchResult,
        hypotheses: Mapping[int, Array],
        tried: list[CostedState],
    ) -> CostedState:
        """The best state that comes of a search; all that are refined go to `tried`."""
        states = [
            dict(zip(result.order, state.poses, strict=True)) for state in result.states
        ]
        refined = self._pool.map(Worker.refine, [(state,) for state in states])
        self._clock.lap("refinement")
        tried += refined
        state, cost = self._most_plausible(refined)
        return self._other_ways(state, cost, hypotheses, tried)

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
            least = max(confidence[k], self._config.trusted_from)
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
        """The state of least fine cost; physics decides if that hardly differs.

        What hides of an object may fit the image in several ways, but not all of them
        carry what lies on it.
        """
        least = min(cost for _, cost in refined)
        limit = least * (1 + self._config.cost_tie_fraction)
        tied = [r for r in refined if r[1] <= limit]
        if len(tied) == 1:
            return tied[0]
        unrest = self._pool.map(Worker.unrest, [(state,) for state, _ in tied])
        beyond = np.maximum(unrest, self._config.rest_tolerance_m)
        return min(zip(beyond, tied, strict=True), key=lambda r: (r[0], r[1][1]))[1]

    def _other_ways(
        self,
        state: dict[int, Array],
        cost: float,
        hypotheses: Mapping[int, Array],
        tried: list[CostedState],
    ) -> CostedState:
        """The state with objects in other poses, if those explain the image better.

        One at a time, each object is turned over and put at each of its hypotheses
        among the others as they are: the search need not have tried the other ways in
        which an object that hardly shows fits the image. It stays as it was found if
        the fine cost falls by less than `cost_tie_fraction`. What is refined for it is
        added to `tried`.
        """
        while True:
            ways = self._pool.map(
                Worker.other_ways, [(state, k, hypotheses[k]) for k in state]
            )
            promising = [
                way
                for way, way_cost in itertools.chain.from_iterable(ways)
                if way_cost < cost * (1 + self._config.refine_within_fraction)
            ]
            refined = self._pool.map(Worker.refine, [(way,) for way in promising])
            tried += refined
            least = min(refined, key=lambda r: r[1], default=(state, cost))
            if least[1] >= cost * (1 - self._config.cost_tie_fraction):
                return state, cost
            state, cost = least

    def _search(
        self, order: Sequence[int], hypotheses: Mapping[int, Array], number: int
    ) -> SearchResult:
        """The search of round `number`."""
        config = self._config.search
        if number > 0:  # what is doubtful is worth all expansions
            config = replace(config, patience_per_object=math.inf)
        selections: list[Selection] = []
        search = GroupSearch(
            order,
            [hypotheses[k] for k in order],
            self._run_rollouts,
            config,
            observer=selections.append,
        )
        if self._config.method is Method.PHYSIM_HEURISTIC:
            result = heuristic_search(search)
        else:
            generator = np.random.default_rng([self._config.seed, number, *order])
            result = monte_carlo_tree_search(search, generator)
        if self._on_search is not None:
            self._on_search(SearchRecord(tuple(selections), result))
        return result

    def _run_rollouts(self, rollouts: Sequence[Rollout]) -> list[RolloutResult]:
        """The results, in the order of the rollouts."""
        # The longest first, so that no worker waits long for another's last one.
        longest = sorted(enumerate(rollouts), key=lambda item: -len(item[1].steps))
        results = self._pool.map(Worker.rollout, [(rollout,) for _, rollout in longest])
        by_number = {n: r for (n, _), r in zip(longest, results, strict=True)}
        return [by_number[n] for n in range(len(rollouts))]


def make_hypotheses(
    pool: WorkerPool,
    config: EstimationConfig,
    requests: Sequence[tuple[int, Placement]],
    number: int,
) -> dict[int, PoseHypotheses]:
    """Hypotheses of objects, from their points less what others explain.

    Args:
        pool: workers that do the computing.
        config: settings, of which the seed is used.
        requests: index of each object, and the poses of the others.
        number: number of the round; each draws other random numbers.

    Returns:
        those of objects that any pose fits.
    """
    found = pool.map(
        Worker.hypotheses,
        [(k, others, (config.seed, number, k)) for k, others in requests],
    )
    return {k: h for (k, _), h in zip(requests, found, strict=True) if len(h.X_SO)}
