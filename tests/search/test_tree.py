# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from itertools import count, product

import numpy as np
import pytest

from physim_drake.poses import Array, make_pose
from physim_drake.search.expansion import Rollout, RolloutResult
from physim_drake.search.group_search import (
    GroupSearch,
    RunRollouts,
    SearchConfig,
    SearchResult,
    TracePoint,
)
from physim_drake.search.tree import heuristic_search, monte_carlo_tree_search

ORDER = (4, 2, 7)
COUNTS = (6, 5, 4)
SETTLED = 0.001


def hypotheses() -> list[Array]:
    """Hypothesis k of an object lies at x = k centimetres."""
    return [
        np.stack([make_pose(p=[0.01 * k, 0.0, 0.0]) for k in range(n)]) for n in COUNTS
    ]


class Table:
    """Runs rollouts by looking their reward up, and notes them.

    Expanding shifts a pose by `SETTLED` along y, so that expanded poses can be told
    from hypotheses.
    """

    def __init__(self, rewards: Array) -> None:
        self.rewards = rewards
        self.rollouts: list[Rollout] = []
        self.paths: list[tuple[int, ...]] = []

    def one(self, rollout: Rollout) -> RolloutResult:
        poses = []
        for _, X in rollout.steps:
            assert X[1, 3] == 0
            poses.append(X @ make_pose(p=[0.0, SETTLED, 0.0]))
        state = [X for _, X in rollout.placed] + poses
        assert all(X[1, 3] == pytest.approx(SETTLED) for X in state)
        path = tuple(round(100 * X[0, 3]) for X in state)
        self.rollouts.append(rollout)
        self.paths.append(path)
        return RolloutResult(tuple(poses), int(self.rewards[path]))

    def __call__(self, rollouts: Sequence[Rollout]) -> list[RolloutResult]:
        return [self.one(rollout) for rollout in rollouts]


def additive(seed: int) -> Array:
    """Rewards to which each object adds its own: what UCT can climb."""
    generator = np.random.default_rng(seed)
    parts = [generator.uniform(0, 1000, n) for n in COUNTS]
    total = parts[0][:, None, None] + parts[1][:, None] + parts[2]
    return np.asarray(total.astype(int))


def search_with(
    run: RunRollouts,
    method: Callable[[GroupSearch], SearchResult],
    clock: Callable[[], float] | None = None,
    **settings: float | str,
) -> SearchResult:
    plain = {"exploration_px": 300.0, "patience_per_object": math.inf}
    config = SearchConfig(**{**plain, **settings})  # type: ignore[arg-type]
    ticks = count()
    clock = clock or (lambda: float(next(ticks)))
    return method(GroupSearch(ORDER, hypotheses(), run, config, clock))


def uct(seed: int = 0) -> Callable[[GroupSearch], SearchResult]:
    return lambda search: monte_carlo_tree_search(search, np.random.default_rng(seed))


def best_of(rewards: Array) -> tuple[int, ...]:
    return tuple(int(i) for i in np.unravel_index(rewards.argmax(), rewards.shape))


@pytest.mark.parametrize("seed", range(6))
def test_uct_finds_the_best_of_a_table_without_trying_all(seed: int) -> None:
    table = Table(additive(seed))
    result = search_with(table, uct(seed), expansions=120)
    # 120 combinations would take 156 expansions in all.
    assert len(set(table.paths)) < 0.8 * table.rewards.size
    assert result.states[0].score >= np.percentile(table.rewards, 98)


def test_uct_spends_more_where_rewards_are_high() -> None:
    rewards = np.zeros(COUNTS, dtype=int)
    rewards[3] = 1000
    table = Table(rewards)
    search_with(table, uct(), expansions=60, exploration_px=100.0)
    tries = np.bincount([path[0] for path in table.paths], minlength=6)
    assert tries.argmax() == 3
    assert (tries > 0).all()


def test_more_exploration_spreads_the_tries() -> None:
    rewards = np.zeros(COUNTS, dtype=int)
    rewards[3] = 1000
    spread = []
    for exploration in (10.0, 1e6):
        table = Table(rewards)
        search_with(table, uct(), expansions=60, exploration_px=exploration)
        spread.append(np.std(np.bincount([p[0] for p in table.paths], minlength=6)))
    assert spread[1] < spread[0]


@pytest.mark.parametrize("method", [uct(), heuristic_search])
def test_a_search_ends_where_nothing_better_was_found_for_long(
    method: Callable[[GroupSearch], SearchResult],
) -> None:
    table = Table(additive(0))
    unlimited = search_with(table, method, expansions=10**9)
    short = search_with(
        Table(additive(0)), method, expansions=10**9, patience_per_object=8
    )
    waits = np.diff([0, *(p.expansion for p in short.trace), short.expansions])
    assert waits[-1] > 8 * len(ORDER)  # since the last better state
    assert (waits[:-1] <= 8 * len(ORDER) + 4 * len(ORDER)).all()  # one round more
    assert short.expansions < unlimited.expansions
    shared = len(short.trace)
    assert [p.score for p in short.trace] == [p.score for p in unlimited.trace[:shared]]


@pytest.mark.parametrize("method", [uct(), heuristic_search])
@pytest.mark.parametrize("round_size", [1, 4, 7])
def test_a_search_without_limits_scores_every_combination_once(
    method: Callable[[GroupSearch], SearchResult], round_size: int
) -> None:
    table = Table(additive(0))
    result = search_with(table, method, expansions=10**9, round_size=round_size)
    assert sorted(table.paths) == sorted(product(*map(range, COUNTS)))
    assert result.states[0].hypotheses == best_of(table.rewards)
    assert result.states[0].score == table.rewards.max()


@pytest.mark.parametrize("method", [uct(), heuristic_search])
@pytest.mark.parametrize("expansions", [1, 10, 50])
@pytest.mark.parametrize("round_size", [1, 4])
def test_the_budget_is_kept(
    method: Callable[[GroupSearch], SearchResult], expansions: int, round_size: int
) -> None:
    table = Table(additive(1))
    result = search_with(table, method, expansions=expansions, round_size=round_size)
    assert result.expansions == sum(len(r.steps) for r in table.rollouts)
    # A round that has begun is finished.
    assert result.expansions < expansions + round_size * len(ORDER)
    assert result.states


def test_time_is_a_limit_too() -> None:
    table = Table(additive(1))
    result = search_with(table, uct(), expansions=10**6, time_limit_s=20.0)
    assert 0 < result.expansions < 100


def test_nothing_is_expanded_twice() -> None:
    table = Table(additive(2))
    search_with(table, uct(), expansions=100, round_size=1)
    expanded = [
        table.paths[n][: len(rollout.placed) + k + 1]
        for n, rollout in enumerate(table.rollouts)
        for k in range(len(rollout.steps))
    ]
    assert len(expanded) == len(set(expanded))


def test_objects_are_placed_in_order() -> None:
    table = Table(additive(2))
    search_with(table, uct(), expansions=60)
    for rollout in table.rollouts:
        indices = [k for k, _ in rollout.placed] + [k for k, _ in rollout.steps]
        assert tuple(indices) == ORDER


@pytest.mark.parametrize("method", [uct(3), heuristic_search])
def test_how_rollouts_are_run_does_not_change_the_result(
    method: Callable[[GroupSearch], SearchResult],
) -> None:
    def backwards(rollouts: Sequence[Rollout]) -> list[RolloutResult]:
        table = Table(additive(3))
        return [table.one(rollout) for rollout in reversed(rollouts)][::-1]

    results = [
        search_with(run, method, expansions=70)
        for run in (Table(additive(3)), backwards)
    ]
    for a, b in zip(results[0].states, results[1].states, strict=True):
        assert a.hypotheses == b.hypotheses
        assert a.score == b.score
        assert a.poses.tobytes() == b.poses.tobytes()
    assert results[0].expansions == results[1].expansions


def test_the_seed_decides_the_rollouts() -> None:
    paths = []
    for seed in (1, 1, 2):
        table = Table(additive(3))
        search_with(table, uct(seed), expansions=40)
        paths.append(table.paths)
    assert paths[0] == paths[1]
    assert paths[0] != paths[2]


def test_time_does_not_change_the_result() -> None:
    slow = count(0, 1000)
    results = [
        search_with(Table(additive(3)), uct(), clock=clock, expansions=70)
        for clock in (None, lambda: float(next(slow)))
    ]
    assert [s.hypotheses for s in results[0].states] == [
        s.hypotheses for s in results[1].states
    ]


@pytest.mark.parametrize("method", [uct(), heuristic_search])
def test_the_trace_rises_to_the_best(
    method: Callable[[GroupSearch], SearchResult],
) -> None:
    result = search_with(Table(additive(4)), method, expansions=80)
    scores = [point.score for point in result.trace]
    assert scores == sorted(set(scores))
    assert scores[-1] == result.states[0].score
    for before, after in zip(result.trace, result.trace[1:], strict=False):
        assert before.expansion <= after.expansion <= result.expansions
        assert before.seconds < after.seconds
    np.testing.assert_array_equal(result.trace[-1].poses, result.states[0].poses)


def test_rollouts_by_lcp_take_the_first_hypotheses() -> None:
    table = Table(additive(5))
    search_with(table, uct(), expansions=18, round_size=1, rollout="best_lcp")
    # The six hypotheses of the first object, each completed with the best.
    assert table.paths[:6] == [(k, 0, 0) for k in range(6)]


def test_children_are_tried_in_the_order_of_their_lcp() -> None:
    table = Table(additive(5))
    search_with(table, uct(), expansions=18, round_size=2)
    assert [path[0] for path in table.paths[:6]] == list(range(6))


def test_the_heuristic_goes_depth_first() -> None:
    table = Table(additive(6))
    search_with(table, heuristic_search, expansions=40, round_size=3)
    expected = list(product(*map(range, COUNTS)))
    assert table.paths == expected[: len(table.paths)]
    # The last object's hypotheses share the state of those before them.
    assert len(table.rollouts[1].placed) + len(table.rollouts[1].steps) == 3


def test_kept_states_are_distinct_and_best_first() -> None:
    rewards = additive(7)
    result = search_with(Table(rewards), uct(), expansions=10**6, kept_states=5)
    scores = [state.score for state in result.states]
    assert scores == sorted(rewards.ravel(), reverse=True)[:5]
    for state in result.states:
        assert rewards[state.hypotheses] == state.score
        x = np.round(100 * state.poses[:, 0, 3]).astype(int)
        assert tuple(x) == state.hypotheses


def test_states_that_settled_alike_count_once() -> None:
    def all_to_one_place(rollouts: Sequence[Rollout]) -> list[RolloutResult]:
        return [RolloutResult(tuple(np.eye(4) for _ in r.steps), 5) for r in rollouts]

    result = search_with(all_to_one_place, uct(), expansions=60)
    assert len(result.states) == 1


def test_a_group_of_one() -> None:
    def run(rollouts: Sequence[Rollout]) -> list[RolloutResult]:
        return [
            RolloutResult((r.steps[0][1],), int(100 * r.steps[0][1][0, 3]))
            for r in rollouts
        ]

    search = GroupSearch((3,), hypotheses()[:1], run, SearchConfig(expansions=100))
    result = monte_carlo_tree_search(search, np.random.default_rng(0))
    assert result.expansions == COUNTS[0]
    assert result.states[0].hypotheses == (5,)


def test_the_state_that_stands_least_in_the_air_is_kept_too() -> None:
    def run(rollouts: Sequence[Rollout]) -> list[RolloutResult]:
        """The farther an object is, the more agrees, and all but the first intrudes."""
        results = []
        for r in rollouts:
            k = round(100 * r.steps[0][1][0, 3])
            results.append(RolloutResult((r.steps[0][1],), 100 + k, 50 if k else 0))
        return results

    config = SearchConfig(expansions=100, kept_states=2)
    search = GroupSearch((3,), hypotheses()[:1], run, config)
    result = monte_carlo_tree_search(search, np.random.default_rng(0))
    assert [state.hypotheses for state in result.states] == [(5,), (4,), (0,)]


def test_the_trace_is_in_the_camera_and_fits_json() -> None:
    X_CS, X_SO = make_pose(p=[0.1, 0.2, 0.9]), make_pose(p=[0.3, 0.0, 0.1])
    result = SearchResult((1, 0), (), (TracePoint(3, 0.5, 700, X_SO[None]),), 42)
    trace = result.as_trace(X_CS)
    assert trace.expansions == 42
    ((expansion, seconds, score, X_CO),) = trace.points
    assert (expansion, seconds, score) == (3, 0.5, 700)
    np.testing.assert_allclose(X_CO[0], X_CS @ X_SO)
    loaded = json.loads(json.dumps(trace.as_dict()))
    np.testing.assert_allclose(loaded["points"][0]["X_CO"], X_CO)
    assert loaded["expansions"] == 42
