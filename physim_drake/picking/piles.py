# SPDX-License-Identifier: MIT
"""Which object lies on which, from estimated poses.

What matters for picking is what would come along: object j is on object i if lifting i
would run into j. So i is shifted up step by step, and j is on it if the overlap of the
two grows. Estimates overlap by millimetres if objects lie side by side; that
overlap does not grow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import networkx as nx
import numpy as np

from physim_drake.objects.model import ObjectModel
from physim_drake.picking.surroundings import PlacedObject
from physim_drake.poses import Array, inverse, transform_points
from physim_drake.registration.registration_model import registration_model

_LIFTS = (0.004, 0.007, 0.010, 0.015, 0.020)
"""m; the first ones are for thin objects, which a larger lift would pass through."""

_GROWTH = 0.0025  # m of overlap


def objects_on(
    placed: Sequence[PlacedObject], up_W: Array | None = None
) -> Mapping[int, frozenset[int]]:
    """Says for each object which others lie on it, or on what lies on it.

    Args:
        placed: the objects, in W.
        up_W: against gravity, unit, (3,); z if it is None.

    Returns:
        the indices of the objects above, by index; objects that hold each other are
        each above the other.
    """
    up = np.array([0.0, 0.0, 1.0]) if up_W is None else up_W
    graph: nx.DiGraph = nx.DiGraph()
    graph.add_nodes_from(item.index for item in placed)
    for lower in placed:
        for upper in placed:
            if lower is not upper and _blocks_lifting(lower, upper, up):
                graph.add_edge(lower.index, upper.index)
    return {
        item.index: frozenset(nx.descendants(graph, item.index)) - {item.index}
        for item in placed
    }


def _blocks_lifting(lower: PlacedObject, upper: PlacedObject, up: Array) -> bool:
    reach = (lower.model.diameter + upper.model.diameter) / 2 + max(_LIFTS)
    if np.linalg.norm(_middle(lower) - _middle(upper)) > reach:
        return False
    before = _overlap(lower.model, lower.X_WO, upper.model, upper.X_WO)
    for lift in _LIFTS:
        X_lifted = lower.X_WO.copy()
        X_lifted[:3, 3] += lift * up
        after = _overlap(lower.model, X_lifted, upper.model, upper.X_WO)
        if after - before > _GROWTH:
            return True
    return False


def _middle(item: PlacedObject) -> Array:
    middle = item.model.mesh.bounds.mean(axis=0)
    return np.asarray(transform_points(item.X_WO, middle[None])[0])


def _overlap(model: ObjectModel, X_WA: Array, other: ObjectModel, X_WB: Array) -> float:
    """How deep surface points of one body are in the other, m, 0 if none is."""
    X_AB = inverse(X_WA) @ X_WB
    depth = 0.0
    for outer, inner, X in ((model, other, X_AB), (other, model, inverse(X_AB))):
        points = transform_points(X, registration_model(inner).points)
        distances, _ = registration_model(outer).distance_field.query(points)
        depth = max(depth, -float(distances.min()))
    return depth
