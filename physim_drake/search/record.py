# SPDX-License-Identifier: MIT
"""What a tree search did, selection by selection, and the tree that it grew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from physim_drake.search.group_search import Path, SearchResult, Selection


@dataclass(frozen=True)
class TreeNode:
    """A partial state of the tree: the group's first objects at some hypotheses.

    Attributes:
        path: indices of those hypotheses, in the group's order.
        visits: selections that went through it.
        mean: mean score of these, in pixels.
        best: the best of them.
        children: children in the order in which they were added, best LCP first.
    """

    path: Path
    visits: int
    mean: float
    best: int
    children: tuple[TreeNode, ...]


@dataclass(frozen=True)
class SearchRecord:
    """One search of one group of objects.

    Attributes:
        selections: selections in their order.
        result: best states and anytime curve.
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
        selections: selections of one search, in their order.
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
