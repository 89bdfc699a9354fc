# SPDX-License-Identifier: MIT
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from physim_drake.poses import make_pose
from physim_drake.search import tree
from physim_drake.search.expansion import Rollout, RolloutResult
from physim_drake.search.group_search import GroupSearch, SearchConfig, Selection
from physim_drake.search.record import TreeNode, grown_tree
from physim_drake.search.tree import monte_carlo_tree_search


def test_each_selection_adds_one_node() -> None:
    root = grown_tree(
        [
            Selection((0, 5), 10, 2),
            Selection((1, 5), 20, 4),
            Selection((1, 0), 40, 5),
            Selection((1, 1), 30, 6),
        ]
    )
    assert (root.visits, root.mean, root.best) == (4, 25.0, 40)
    first, second = root.children
    assert (first.path, first.visits, first.children) == ((0,), 1, ())
    assert (second.path, second.visits, second.mean) == ((1,), 3, 30.0)
    assert [child.path for child in second.children] == [(1, 0), (1, 1)]


def test_no_selection_no_tree() -> None:
    assert grown_tree([]) == TreeNode((), 0, 0.0, 0, ())


def run_all(rollouts: Sequence[Rollout]) -> list[RolloutResult]:
    """The score of a state is a sum that some hypotheses add more to."""
    return [
        RolloutResult(
            tuple(X for _, X in r.steps),
            sum(int(7 * X[0, 3]) % 5 for _, X in (*r.placed, *r.steps)),
        )
        for r in rollouts
    ]


def watched_search(
    counts: Sequence[int], expansions: int, selections: list[Selection]
) -> GroupSearch:
    """A search over numbers whose selections are taken down."""
    hypotheses = [
        np.stack([make_pose(p=[float(n), 0.0, 0.0]) for n in range(count)])
        for count in counts
    ]
    config = SearchConfig(expansions=expansions, exploration_px=3.0)
    order = range(len(counts))
    return GroupSearch(order, hypotheses, run_all, config, observer=selections.append)


def as_grown(node: Any) -> TreeNode:
    """A node of the search itself."""
    below = tuple(as_grown(child) for child in node.children)
    scores = node.reward / max(node.visits, 1)
    return TreeNode(node.path, node.visits, scores, -1, below)


def without_best(node: TreeNode) -> TreeNode:
    below = tuple(without_best(child) for child in node.children)
    return TreeNode(node.path, node.visits, node.mean, -1, below)


@pytest.mark.parametrize(
    ("counts", "expansions"),
    [([4], 100), ([6, 5], 40), ([3, 2, 4], 500), ([9] * 4, 90)],
)
def test_the_tree_is_the_one_that_was_searched(
    counts: list[int], expansions: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    roots: list[Any] = []
    back_up = tree._back_up

    def watched(leaf: Any, reward: float) -> None:
        root = leaf
        while root.parent is not None:
            root = root.parent
        roots.append(root)
        back_up(leaf, reward)

    monkeypatch.setattr(tree, "_back_up", watched)
    selections: list[Selection] = []
    search = watched_search(counts, expansions, selections)
    monte_carlo_tree_search(search, np.random.default_rng(0))
    assert without_best(grown_tree(selections)) == as_grown(roots[0])
