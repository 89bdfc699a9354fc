# SPDX-License-Identifier: MIT
"""A way around obstacles: RRT-Connect, and shortcuts on what it finds.

Two trees grow from both ends, one towards a random sample, the other towards what the
first has just reached, until they meet (Kuffner and LaValle, "RRT-Connect", ICRA 2000).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from physim_drake.poses import Array

EdgeFree = Callable[[Array, Array], bool]


class _Tree:
    """Nodes that each know their parent. Distances are Euclidean after scaling."""

    def __init__(self, root: Array, weights: Array, capacity: int) -> None:
        self.nodes = np.empty((capacity, len(root)))
        self.nodes[0] = root
        self.parents = [-1]
        self._weights = weights

    def nearest(self, q: Array) -> int:
        offsets = self._weights * (self.nodes[: len(self.parents)] - q)
        return int(np.einsum("ni,ni->n", offsets, offsets).argmin())

    def add(self, q: Array, parent: int) -> int:
        if len(self.parents) == len(self.nodes):
            self.nodes = np.concatenate([self.nodes, np.empty_like(self.nodes)])
        self.nodes[len(self.parents)] = q
        self.parents.append(parent)
        return len(self.parents) - 1

    def branch(self, n: int) -> list[Array]:
        """Nodes from `n` to the root."""
        nodes = []
        while n >= 0:
            nodes.append(self.nodes[n].copy())
            n = self.parents[n]
        return nodes

    def step_towards(
        self, n: int, q: Array, step: float, edge_free: EdgeFree
    ) -> tuple[int | None, bool]:
        """Grows from node `n` by a step; returns the new node and whether it is `q`."""
        start = self.nodes[n].copy()
        length = float(np.linalg.norm(self._weights * (q - start)))
        arrives = length <= step
        end = q if arrives else start + (q - start) * (step / length)
        if not edge_free(start, end):
            return None, False
        return self.add(end, n), arrives


def rrt_connect(
    q_start: Array,
    q_goal: Array,
    lower: Array,
    upper: Array,
    weights: Array,
    edge_free: EdgeFree,
    generator: np.random.Generator,
    iterations: int,
    step: float = 0.25,
) -> Array | None:
    """Searches a free polyline between two free configurations.

    Args:
        q_start: (n,).
        q_goal: (n,).
        lower: lower limits of the samples, (n,).
        upper: upper limits of the samples, (n,).
        weights: length of a motion is that of `weights * dq`, (n,).
        edge_free: whether a straight motion is free.
        generator: random source of the samples.
        iterations: greatest number of samples.
        step: length of an edge.

    Returns:
        the polyline, (N, n), both ends included; None if none was found.
    """
    trees = [_Tree(q, weights, iterations + 1) for q in (q_start, q_goal)]
    for turn in range(iterations):
        growing, other = trees[turn % 2], trees[1 - turn % 2]
        sample = generator.uniform(lower, upper)
        new, _ = growing.step_towards(growing.nearest(sample), sample, step, edge_free)
        if new is None:
            continue
        target = growing.nodes[new].copy()
        reached: int | None = other.nearest(target)
        arrived = False
        while reached is not None and not arrived:
            reached, arrived = other.step_towards(reached, target, step, edge_free)
        if reached is not None:
            ahead, back = growing.branch(new)[::-1], other.branch(reached)[1:]
            path = np.array(ahead + back)
            return path if turn % 2 == 0 else path[::-1].copy()
    return None


def shortcut(
    path: Array,
    edge_free: EdgeFree,
    weights: Array,
    generator: np.random.Generator,
    attempts: int = 30,
) -> Array:
    """Replaces detours of a free polyline by straight motions that are free.

    Args:
        path: (N, n).
        edge_free: whether a straight motion is free.
        weights: as in `rrt_connect`.
        generator: random source of the places that are tried.
        attempts: number of tries.
    """
    path = _leap(path, edge_free)
    for _ in range(attempts):
        if len(path) < 3:
            break
        lengths = np.linalg.norm(weights * np.diff(path, axis=0), axis=1)
        ends = np.concatenate([[0.0], np.cumsum(lengths)])
        first, last = np.sort(generator.uniform(0, ends[-1], size=2))
        i, j = (int(np.searchsorted(ends, s, "right")) - 1 for s in (first, last))
        if i == j:
            continue
        a = path[i] + (path[i + 1] - path[i]) * (first - ends[i]) / lengths[i]
        b = path[j] + (path[j + 1] - path[j]) * (last - ends[j]) / lengths[j]
        if edge_free(a, b):
            path = np.concatenate([path[: i + 1], [a, b], path[j + 1 :]])
            path = _without_repeats(path, weights)
    return path


def _leap(path: Array, edge_free: EdgeFree) -> Array:
    """Goes from each point straight to the farthest later one that is in free reach."""
    kept, n = [0], 0
    while n < len(path) - 1:
        n = next(
            (m for m in range(len(path) - 1, n + 1, -1) if edge_free(path[n], path[m])),
            n + 1,
        )
        kept.append(n)
    return path[kept]


def _without_repeats(path: Array, weights: Array) -> Array:
    """Drops points that coincide with the one before, and those on a straight line."""
    kept = [path[0]]
    for n in range(1, len(path) - 1):
        before, after = (
            weights * (path[n] - kept[-1]),
            weights * (path[n + 1] - path[n]),
        )
        lengths = np.linalg.norm(before) * np.linalg.norm(after)
        if lengths > 1e-12 and before @ after < (1 - 1e-9) * lengths:
            kept.append(path[n])
    return np.array([*kept, path[-1]])
