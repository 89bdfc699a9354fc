# SPDX-License-Identifier: MIT
"""UCT over the hypotheses of one group of objects (Algorithm 3 of the paper).

Rollouts run in rounds of a fixed size, whatever the number of workers: each selection
counts as a visit at once, so that the next one looks elsewhere, and rewards are added
in the order of selection. So the same seed gives the same poses on any machine.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice

import numpy as np

from physim_drake.search.group_search import GroupSearch, Path, SearchResult


@dataclass
class _Node:
    path: Path
    untried: list[int]
    parent: _Node | None = None
    children: list[_Node] = field(default_factory=list)
    visits: int = 0
    reward: float = 0.0
    closed: bool = False
    pending: bool = False


def monte_carlo_tree_search(
    search: GroupSearch, generator: np.random.Generator
) -> SearchResult:
    """UCT: selects, expands, rolls out and backs up until the budget is spent.

    Unexpanded children are taken in the order of the hypotheses, best LCP first. The
    search also ends when every combination has been scored.
    """
    root = _Node((), list(range(len(search.hypotheses[0]))))
    while not search.spent and not root.closed:
        leaves: list[_Node] = []
        while len(leaves) < search.config.round_size:
            leaf = _select(root, search)
            if leaf is None:
                break
            leaves.append(leaf)
        paths = [_complete(leaf.path, search, generator) for leaf in leaves]
        for leaf, reward in zip(leaves, search.score(paths), strict=True):
            leaf.pending = False
            _back_up(leaf, reward)
    return search.result()


def _select(root: _Node, search: GroupSearch) -> _Node | None:
    """Descends by UCB to a node with an untried child, adds it, counts the visit."""
    node = root
    while not node.untried:
        open_children = [c for c in node.children if not (c.closed or c.pending)]
        if not open_children:
            return None
        # The visits of selections in flight count, their rewards do not yet.
        parent_visits = max(node.visits, 1)
        node = max(
            open_children,
            key=lambda c: (
                c.reward / c.visits
                + search.config.exploration_px
                * math.sqrt(2 * math.log(parent_visits) / c.visits)
            ),
        )
    choice = node.untried.pop(0)
    path = (*node.path, choice)
    terminal = len(path) == search.depth
    untried = [] if terminal else list(range(len(search.hypotheses[len(path)])))
    child = _Node(path, untried, node, closed=terminal, pending=True)
    node.children.append(child)
    up: _Node | None = child
    while up is not None:
        up.visits += 1
        up = up.parent
    return child


def _complete(path: Path, search: GroupSearch, generator: np.random.Generator) -> Path:
    """Draws a hypothesis for every object that the path leaves open."""
    counts = [len(h) for h in search.hypotheses[len(path) :]]
    if search.config.rollout == "best_lcp":
        return (*path, *(0 for _ in counts))
    return (*path, *(int(generator.integers(n)) for n in counts))


def _back_up(leaf: _Node, reward: float) -> None:
    node: _Node | None = leaf
    while node is not None:
        node.reward += reward
        if not node.untried and node.children:
            node.closed = all(child.closed for child in node.children)
        node = node.parent


def heuristic_search(search: GroupSearch) -> SearchResult:
    """PHYSIM-Heuristic: depth first, best LCP first (the paper, section IV-C)."""
    paths = _depth_first([len(h) for h in search.hypotheses])
    exhausted = False
    while not search.spent and not exhausted:
        batch = list(islice(paths, search.config.round_size))
        exhausted = len(batch) < search.config.round_size
        search.score(batch)
    return search.result()


def _depth_first(counts: Sequence[int]) -> Iterator[Path]:
    if not counts:
        yield ()
        return
    for head in range(counts[0]):
        for tail in _depth_first(counts[1:]):
            yield (head, *tail)
