# SPDX-License-Identifier: MIT
"""Which object has to be placed before which (the paper, section III-C).

Two rules draw an edge i -> j (i first): the footprints of their segments on the
support surface overlap and j's centroid is higher; or their boxes overlap in the image
and j's centroid is farther from the camera. The first rule alone cannot cycle, heights
being ordered. If the rules contradict each other, support wins: edges of the second
rule are added from the largest difference in depth down, and one that would close a
cycle is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import networkx as nx
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from physim_drake.observation.observation import Segment
from physim_drake.poses import Array


@dataclass(frozen=True)
class DependencyGraph:
    """A partial order of the segments, and the groups that must be searched together.

    Attributes:
        edges: (i, j): segment i is placed before segment j.
        components: the independent groups, each in an order that respects the edges.
    """

    edges: tuple[tuple[int, int], ...]
    components: tuple[tuple[int, ...], ...]


def dependency_graph(segments: Sequence[Segment], X_CS: Array) -> DependencyGraph:
    """Orders the objects of a scene.

    Args:
        segments: one an object; empty ones depend on nothing.
        X_CS: the support frame, whose x-y plane the first rule uses, in the camera.
    """
    graph: nx.DiGraph = nx.DiGraph()
    graph.add_nodes_from(range(len(segments)))
    filled = [i for i, segment in enumerate(segments) if len(segment.points)]
    centroids = {i: segments[i].points.mean(axis=0) for i in filled}
    hulls = {i: _footprint(segments[i].points[:, :2]) for i in filled}
    for i, j in combinations(filled, 2):
        if _convex_overlap(hulls[i], hulls[j]):
            low, high = (i, j) if centroids[i][2] <= centroids[j][2] else (j, i)
            graph.add_edge(low, high)
    depth = {i: float(centroids[i] @ X_CS[2, :3]) for i in filled}
    occlusions = [
        (abs(depth[i] - depth[j]), *((i, j) if depth[i] <= depth[j] else (j, i)))
        for i, j in combinations(filled, 2)
        if _boxes_overlap(segments[i].detection.box, segments[j].detection.box)
    ]
    for _, near, far in sorted(occlusions, key=lambda o: (-o[0], o[1], o[2])):
        if not nx.has_path(graph, far, near):
            graph.add_edge(near, far)
    heights = {n: float(centroid[2]) for n, centroid in centroids.items()}
    components = []
    for members in nx.weakly_connected_components(graph):
        order = nx.lexicographical_topological_sort(
            graph.subgraph(members), key=lambda n: (heights.get(n, 0.0), n)
        )
        components.append(tuple(order))
    return DependencyGraph(
        tuple(sorted(graph.edges)), tuple(sorted(components, key=min))
    )


def _footprint(points: Array) -> Array:
    """Corners of the convex hull of points (N, 2)."""
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        return points


def _convex_overlap(A: Array, B: Array) -> bool:
    """Whether two convex polygons (N, 2) overlap: no edge's normal parts them."""
    for polygon in (A, B):
        edges = np.roll(polygon, -1, axis=0) - polygon
        axes = np.stack([-edges[:, 1], edges[:, 0]], axis=1)
        a, b = A @ axes.T, B @ axes.T
        apart = (a.max(axis=0) < b.min(axis=0)) | (b.max(axis=0) < a.min(axis=0))
        if apart.any():
            return False
    return True


def _boxes_overlap(a: Array, b: Array) -> bool:
    return bool(a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3])
