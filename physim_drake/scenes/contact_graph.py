# SPDX-License-Identifier: MIT
"""Interaction levels from who touches whom.

The paper tells scenes apart by how many objects depend on each other (Mitash et al.,
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
        distances: m, by pair of object indices.
        touching: m.
    """
    return tuple(
        sorted((min(p), max(p)) for p, d in distances.items() if d <= touching)
    )


def interaction_levels(count: int, edges: Iterable[Pair]) -> tuple[int, ...]:
    """The level of each of `count` objects, 1 to `MAX_LEVEL`."""
    graph = nx.Graph(edges)
    graph.add_nodes_from(range(count))
    levels = {
        node: min(len(component), MAX_LEVEL)
        for component in nx.connected_components(graph)
        for node in component
    }
    return tuple(levels[node] for node in range(count))
