# SPDX-License-Identifier: MIT
"""What any search over the hypotheses of one group of objects has: budget and memory.

Complete states are scored in rounds; only what no earlier state has in common is
expanded, and the best states and the anytime curve are kept.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from physim_drake.poses import Array
from physim_drake.scene_estimate import SearchTrace
from physim_drake.search.expansion import Rollout, RolloutResult

RunRollouts = Callable[[Sequence[Rollout]], list[RolloutResult]]
Path = tuple[int, ...]


@dataclass(frozen=True)
class SearchConfig:
    """Budget and constants of the tree search.

    Attributes:
        expansions: no round begins after this many expansions of a group.
        patience_per_object: nor after this many for each of its objects without a
            better state; infinite if a group is searched again.
        time_limit_s: seconds a group; none by default, since it ends reproducibility.
        exploration_px: the UCB constant alpha, in pixels.
        rollout: choice of hypotheses below the tree: at random, or the best LCP.
        round_size: rollouts selected before any of them is scored.
        kept_states: number of complete states passed to refinement, those with the
            highest C. The state with the highest C less the pixels drawn before what
            the camera saw is added if it is not one of them, since C does not fall if
            half an object stands in the air.
    """

    expansions: int = 250
    patience_per_object: float = 30
    time_limit_s: float = math.inf
    exploration_px: float = 5000.0
    rollout: Literal["random", "best_lcp"] = "random"
    round_size: int = 4
    kept_states: int = 4


@dataclass(frozen=True)
class ScoredState:
    """A complete state of a group.

    Attributes:
        hypotheses: index of the hypothesis each object started from.
        poses: X_SO of each object, (N, 4, 4), in the group's order.
        score: C, in pixels.
    """

    hypotheses: Path
    poses: Array
    score: int


@dataclass(frozen=True)
class Selection:
    """A complete state that was selected and scored.

    Attributes:
        path: index of the hypothesis that each object of the group started from.
        score: C of the state, in pixels.
        expansions: made by the search when the score was known.
    """

    path: Path
    score: int
    expansions: int


@dataclass(frozen=True)
class TracePoint:
    """The best state at one moment of a search.

    Attributes:
        expansion: number of expansions made by then.
        seconds: since the search began.
        score: best C so far, in pixels.
        poses: X_SO (N, 4, 4) of that state, in the group's order.
    """

    expansion: int
    seconds: float
    score: int
    poses: Array


@dataclass(frozen=True)
class SearchResult:
    """What a search found.

    Attributes:
        order: indices of the objects, in the order they were placed.
        states: the best complete states (see `kept_states`), best first; empty if none
            was scored.
        trace: the anytime curve, a point each time the best score rose.
        expansions: number of expansions made.
    """

    order: tuple[int, ...]
    states: tuple[ScoredState, ...]
    trace: tuple[TracePoint, ...]
    expansions: int

    def as_trace(self, X_CS: Array) -> SearchTrace:
        """The anytime curve with poses in the camera; X_CS of the scene, (4, 4)."""
        points = tuple(
            (p.expansion, p.seconds, p.score, X_CS @ p.poses) for p in self.trace
        )
        return SearchTrace(self.order, points, self.expansions)


class GroupSearch:
    """The state that MCTS and the depth-first heuristic share.

    Args:
        order: indices of the group's objects, in placing order.
        hypotheses: X_SO (K, 4, 4) of each object of the group, best LCP first.
        run: scores rollouts, in order.
        config: budget.
        clock: seconds, for the trace and the time limit.
        observer: hears of each selection, in their order.
    """

    def __init__(
        self,
        order: Sequence[int],
        hypotheses: Sequence[Array],
        run: RunRollouts,
        config: SearchConfig,
        clock: Callable[[], float] = time.monotonic,
        observer: Callable[[Selection], None] | None = None,
    ) -> None:
        self.order, self.hypotheses, self.config = tuple(order), hypotheses, config
        self._run, self._clock, self._start = run, clock, clock()
        self._observer = observer
        self._poses: dict[Path, Array] = {}
        self._scores: dict[Path, int] = {}
        self._clear: dict[Path, int] = {}
        self._trace: list[TracePoint] = []
        self._best = -1
        self._risen = 0  # expansions when the best score last rose
        self.expansions = 0

    @property
    def depth(self) -> int:
        """How many objects the group has."""
        return len(self.order)

    @property
    def spent(self) -> bool:
        """Whether the budget or the patience is used up."""
        patience = self.config.patience_per_object * self.depth
        return (
            self.expansions >= self.config.expansions
            or self.expansions - self._risen > patience
            or self._clock() - self._start > self.config.time_limit_s
        )

    def score(self, paths: Sequence[Path]) -> list[int]:
        """Scores complete paths, expanding only what no earlier path has expanded."""
        todo: list[tuple[Path, int]] = []
        for path in dict.fromkeys(paths):
            if path not in self._scores:
                known = self._known_prefix(path)
                todo.append((path, known))
                self.expansions += len(path) - known
        results = self._run([self._rollout(path, known) for path, known in todo])
        for (path, known), result in zip(todo, results, strict=True):
            for n, X_SO in enumerate(result.poses):
                self._poses[path[: known + n + 1]] = X_SO
            self._scores[path] = result.score
            self._clear[path] = result.score - result.intruding
            if result.score > self._best:
                self._best, self._risen = result.score, self.expansions
                self._record(path)
        scores = [self._scores[path] for path in paths]
        if self._observer is not None:
            for path, score in zip(paths, scores, strict=True):
                self._observer(Selection(path, score, self.expansions))
        return scores

    def result(self) -> SearchResult:
        """The best distinct states and the trace."""
        by_score = sorted(self._scores, key=lambda path: (-self._scores[path], path))
        clear = max(self._clear, key=lambda path: self._clear[path], default=None)
        states: list[ScoredState] = []
        for path in by_score:
            if len(states) < self.config.kept_states or path == clear:
                state = ScoredState(path, self._path_poses(path), self._scores[path])
                if all(_distinct(state.poses, other.poses) for other in states):
                    states.append(state)
        return SearchResult(
            self.order, tuple(states), tuple(self._trace), self.expansions
        )

    def _known_prefix(self, path: Path) -> int:
        known = len(path)
        while known and path[:known] not in self._poses:
            known -= 1
        return known

    def _rollout(self, path: Path, known: int) -> Rollout:
        placed = [(self.order[n], self._poses[path[: n + 1]]) for n in range(known)]
        steps = [
            (self.order[n], self.hypotheses[n][path[n]])
            for n in range(known, len(path))
        ]
        return Rollout(tuple(placed), tuple(steps))

    def _path_poses(self, path: Path) -> Array:
        return np.stack([self._poses[path[: n + 1]] for n in range(len(path))])

    def _record(self, path: Path) -> None:
        self._trace.append(
            TracePoint(
                self.expansions,
                self._clock() - self._start,
                self._best,
                self._path_poses(path),
            )
        )


def _distinct(a: Array, b: Array) -> bool:
    """Whether two states differ by more than 2 mm or about 1 degree in an object."""
    shift = np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=1).max()
    turn = np.abs(a[:, :3, :3] - b[:, :3, :3]).max()
    return bool(shift > 0.002 or turn > 0.02)
