# SPDX-License-Identifier: MIT
"""What a tree search did, selection by selection, and the tree that it grew.

The first search of each group is run again, with the seeds of the estimator, and
watched: so its tree is the one that the estimate came from, and estimating itself pays
nothing for being explained.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from physim_drake.estimation.estimator import EstimationConfig
from physim_drake.estimation.workers import Worker, WorkerPool
from physim_drake.hypotheses.generation import PoseHypotheses
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.segmented_scene import Scene
from physim_drake.search.dependency import DependencyGraph
from physim_drake.search.expansion import Rollout, RolloutResult
from physim_drake.search.tree import (
    GroupSearch,
    Path,
    SearchResult,
    monte_carlo_tree_search,
)


@dataclass(frozen=True)
class Selection:
    """One descent of the tree and the complete state that came of it.

    Attributes:
        path: index of the hypothesis that each object of the group started from.
        score: C of the state, in pixels.
        expansions: made by the search when it was known.
    """

    path: Path
    score: int
    expansions: int


@dataclass(frozen=True)
class TreeNode:
    """A partial state of the tree: the group's first objects at some hypotheses.

    Attributes:
        path: those hypotheses, by index, in the group's order.
        visits: selections that went through it.
        mean: mean score of these, in pixels.
        best: the best of them.
        children: in the order in which they were added, best LCP first.
    """

    path: Path
    visits: int
    mean: float
    best: int
    children: tuple[TreeNode, ...]


@dataclass(frozen=True)
class SearchRecord:
    """The first search of one group of objects.

    Attributes:
        selections: in their order.
        result: what the search gave.
    """

    selections: tuple[Selection, ...]
    result: SearchResult

    @property
    def order(self) -> tuple[int, ...]:
        """Indices of the group's objects, in placing order."""
        return self.result.order

    def tree(self) -> TreeNode:
        """The tree at the end of the search."""
        return grown_tree(self.selections)


def grown_tree(selections: Sequence[Selection]) -> TreeNode:
    """The tree that UCT has grown with these selections.

    A selection adds one node: the shortest part of its path that is not in the tree
    yet. What follows in the path was drawn at random.

    Args:
        selections: of one search, in their order.
    """
    scores: dict[Path, list[int]] = {(): []}
    for selection in selections:
        for length in range(len(selection.path) + 1):
            node = selection.path[:length]
            added = node not in scores
            scores.setdefault(node, []).append(selection.score)
            if added:
                break
    children: dict[Path, list[Path]] = {}
    for path in scores:
        if path:
            children.setdefault(path[:-1], []).append(path)

    def node_at(path: Path) -> TreeNode:
        """The node at the end of a path, with all below it."""
        known = scores[path] or [0]
        below = tuple(node_at(child) for child in children.get(path, ()))
        mean = sum(known) / len(known)
        return TreeNode(path, len(scores[path]), mean, max(known), below)

    return node_at(())


class _WatchedSearch(GroupSearch):
    """Remembers what was selected."""

    selections: tuple[Selection, ...] = ()

    def score(self, paths: Sequence[Path]) -> list[int]:
        """Scores complete paths as the search does, and notes them."""
        scores = super().score(paths)
        self.selections += tuple(
            Selection(path, score, self.expansions)
            for path, score in zip(paths, scores, strict=True)
        )
        return scores


def record_searches(
    scene: Scene,
    graph: DependencyGraph,
    hypotheses: Mapping[int, PoseHypotheses],
    library: ObjectLibrary,
    config: EstimationConfig,
) -> tuple[SearchRecord, ...]:
    """Searches every group as `PoseEstimator` does first, and records it.

    Args:
        scene: the image made ready.
        graph: of its segments.
        hypotheses: of the objects that can be searched for, by index.
        library: the objects' models.
        config: of the estimate; its method is not looked at.

    Returns:
        a record for each group that has an object to search for.
    """
    records = []
    with WorkerPool(library, config.steps) as pool:
        pool.set_scene(scene)

        def run(rollouts: Sequence[Rollout]) -> list[RolloutResult]:
            return pool.map(Worker.rollout, [(rollout,) for rollout in rollouts])

        for component in graph.components:
            order = [k for k in component if k in hypotheses]
            if not order:
                continue
            poses = [hypotheses[k].poses for k in order]
            search = _WatchedSearch(order, poses, run, config.search)
            generator = np.random.default_rng([config.seed, 0, *order])
            result = monte_carlo_tree_search(search, generator)
            records.append(SearchRecord(search.selections, result))
    return tuple(records)
