# SPDX-License-Identifier: MIT
"""Interaction levels from the contacts of objects.

The paper distinguishes scenes by how many objects depend on each other (Mitash et al.,
"Physics-aware 6D pose estimation with Monte Carlo tree search", section V: independent,
two-object and three-object dependency). Here an object's level is the number of objects
in its connected component of the contact graph, at most 3.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import networkx as nx

Pair = tuple[int, int]
MAX_LEVEL = 3


def contact_edges(distances: Mapping[Pair, float], touching: float) -> tuple[Pair, ...]:
    """The pairs of objects no farther apart than `touching`, in ascending order.

    Args:
        distances: distance by pair of object indices, m.
        touching: greatest distance of objects in contact, m.
    """
    return tuple(
        sorted((min(p), max(p)) for p, d in distances.items() if d <= touching)
    )


def interaction_levels(count: int, edges: Iterable[Pair]) -> tuple[int, ...]:
    """The level of each of `count` objects, 1 to `MAX_LEVEL`."""
    levels = {
        node: min(len(group), MAX_LEVEL)
        for group in _groups(count, edges)
        for node in group
    }
    return tuple(levels[node] for node in range(count))


def largest_group(count: int, edges: Iterable[Pair]) -> int:
    """Number of objects in the largest connected component of `count` objects."""
    return max(map(len, _groups(count, edges)))


def _groups(count: int, edges: Iterable[Pair]) -> list[set[int]]:
    graph = nx.Graph(edges)
    graph.add_nodes_from(range(count))
    return list(nx.connected_components(graph))
