# SPDX-License-Identifier: MIT
"""Diagrams of an explanation: scores of hypotheses, the search's curve and its tree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import networkx as nx
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, to_hex
from matplotlib.figure import Figure

from physim_drake.reporting.explanation import Explanation
from physim_drake.reporting.html import page_style, svg
from physim_drake.scene_estimate import SearchTrace
from physim_drake.search.record import SearchRecord, TreeNode

_ALL, _KEPT, _BEST, _TRUE = "#7f9fc4", "#e08214", "#d62728", "#2ca02c"
_SHOWN = 800  # poses on a map
_LEAST_MAP = 1.0  # of a map's sides, cm
_GRID: dict[str, Any] = {"alpha": 0.2, "linewidth": 0.6}
_ABOVE: dict[str, Any] = {
    "fontsize": 8,
    "ncols": 4,
    "loc": "lower center",
    "bbox_to_anchor": (0.5, 1.0),
    "columnspacing": 1.2,
    "handletextpad": 0.5,
}


def score_histogram(explanation: Explanation, k: int) -> Markup:
    """How well all poses of object `k` score, and which of them are kept."""
    found = explanation.hypotheses[k]
    name = explanation.names[k]
    with page_style():
        figure = Figure(figsize=(4.2, 2.6), layout="constrained")
        axes = figure.add_subplot()
        top = max(float(found.lcp.max()), 1e-3)
        bins = np.linspace(0.0, top, 41).tolist()
        counts, _, _ = axes.hist(found.lcp, bins=bins, color=_ALL, label="all poses")
        # A rug below the bars, so that few are seen beside thousands.
        floor = -0.06 * float(np.max(counts))
        heights = np.full(len(found.scores), floor)
        axes.plot(found.scores, heights, "|", color=_KEPT, markersize=9, label="kept")
        axes.plot(
            found.scores[:1], heights[:1], "v", color=_BEST, markersize=6, label="best"
        )
        nearest = explanation.nearest_representative(k)
        if nearest is not None:
            axes.axvline(
                float(found.scores[nearest]),
                color=_TRUE,
                linewidth=1.2,
                linestyle="--",
                label="nearest to the truth",
            )
        axes.set_xlabel("score (share of the segment explained)")
        axes.set_ylabel("poses")
        axes.legend(**_ABOVE)
        return svg(figure, f"Histogram of the scores of {name}'s hypotheses")


def pose_map(explanation: Explanation, k: int) -> Markup:
    """Where the poses of object `k` are, seen from above, and which are kept."""
    found = explanation.hypotheses[k]
    name = explanation.names[k]
    order = np.argsort(-found.lcp, kind="stable")[:_SHOWN]
    middle = explanation.library[found.object_id].mesh.bounds.mean(axis=0)
    centres = 100 * (found.X_SO[:, :3, :3] @ middle + found.X_SO[:, :3, 3])
    kept = centres[found.representatives]
    with page_style():
        figure = Figure(figsize=(3.4, 2.6), layout="constrained")
        axes = figure.add_subplot()
        axes.plot(*centres[order, :2].T, ".", color=_ALL, markersize=2, alpha=0.5)
        axes.plot(*kept[:, :2].T, "o", color=_KEPT, markersize=4, label="kept")
        axes.plot(*kept[:1, :2].T, "v", color=_BEST, markersize=6, label="best")
        truth = explanation.truth[k]
        if truth is not None:
            X_SO = np.linalg.inv(explanation.scene.X_CS) @ truth
            x, y = 100 * (X_SO[:3, :3] @ middle + X_SO[:3, 3])[:2]
            axes.plot(x, y, "x", color=_TRUE, markersize=8, label="true")
        # Poses that differ by hairbreadths are shown as the one place that they are.
        middle = kept[:, :2].mean(axis=0)
        axes.update_datalim([middle - _LEAST_MAP / 2, middle + _LEAST_MAP / 2])
        axes.set_aspect("equal", adjustable="datalim")
        axes.locator_params(axis="x", nbins=5)
        axes.set_xlabel("x, cm")
        axes.set_ylabel("y, cm")
        axes.grid(**_GRID)
        axes.legend(**_ABOVE)
        return svg(figure, f"Map of the hypotheses of {name}, seen from above")


def anytime_curve(
    record: SearchRecord, later: Sequence[SearchTrace], pixels: int
) -> Markup:
    """Scores of all complete states of a search, and the best so far.

    Args:
        record: the group's first search.
        later: traces of its further searches.
        pixels: number of pixels of the group's segments.
    """
    with page_style():
        figure = Figure(figsize=(9.0, 3.0), layout="constrained")
        axes = figure.add_subplot()
        axes.plot(
            [s.expansions for s in record.selections],
            [s.score for s in record.selections],
            ".",
            color=_ALL,
            markersize=3,
            label="a state tried",
        )
        first = [(p.expansion, p.score) for p in record.result.trace]
        _add_best(axes, first, record.result.expansions, "best so far")
        for number, trace in enumerate(later, start=2):
            points = [(expansion, score) for expansion, _, score, _ in trace.points]
            _add_best(axes, points, trace.expansions, f"search {number}", ":")
        if pixels:
            axes.axhline(
                pixels,
                color=_TRUE,
                linewidth=0.8,
                linestyle="--",
                label="pixels of the segments",
            )
        axes.set_xlabel("expansions")
        axes.set_ylabel("score, pixels explained")
        axes.grid(**_GRID)
        axes.legend(**_ABOVE)
        return svg(figure, "Score against expansions")


def _add_best(
    axes: Axes,
    points: Sequence[tuple[int, int]],
    expansions: int,
    label: str,
    line: str = "-",
) -> None:
    """Draws the best score so far as steps, up to the search's last expansion."""
    if points:
        steps = np.array([*points, (expansions, points[-1][1])])
        axes.step(*steps.T, where="post", color=_BEST, linestyle=line, label=label)


@dataclass(frozen=True)
class Block:
    """A node of a search tree, drawn as a block in the row of its last object.

    Attributes:
        x: left end, 0..1 of the width.
        width: share of the width, by its visits.
        row: 0 for the group's first object.
        color: by the mean score.
        dark: whether `color` is dark.
        rank: rank of the hypothesis, from 1.
        text: text that a reader sees on pointing at it.
        best: whether the best state came through it.
    """

    x: float
    width: float
    row: int
    color: str
    dark: bool
    rank: int
    text: str
    best: bool


def tree_blocks(record: SearchRecord, names: Sequence[str]) -> list[Block]:
    """A search's tree as rows of blocks, one below the other.

    Args:
        record: the search.
        names: names of all objects.
    """
    root = record.tree()
    means = [node.mean for node in _below(root)]
    # A few bad hypotheses would take all the colours.
    low, high = np.percentile(means or [0.0], [10, 100])
    colors = Normalize(low, max(high, low + 1e-9), clip=True)
    return _blocks_below(root, record, names, colors, 0.0, 1.0)


def _blocks_below(
    node: TreeNode,
    record: SearchRecord,
    names: Sequence[str],
    colors: Normalize,
    x: float,
    width: float,
) -> list[Block]:
    """The blocks below a node that is drawn from `x` on and `width` wide."""
    best = record.result.states[0].hypotheses if record.result.states else ()
    blocks: list[Block] = []
    for child in node.children:
        share = width * child.visits / max(node.visits, 1)
        row = len(child.path) - 1
        value = float(colors(child.mean))
        hypothesis = child.path[-1] + 1
        blocks.append(
            Block(
                x,
                share,
                row,
                to_hex(matplotlib.colormaps["viridis"](value)),
                value < 0.6,
                hypothesis,
                f"{names[record.order[row]]} at hypothesis {hypothesis}: "
                f"tried {child.visits} times, score {child.mean:,.0f} on average, "
                f"{child.best:,} at best",
                child.path == best[: row + 1],
            )
        )
        blocks += _blocks_below(child, record, names, colors, x, share)
        x += share
    return blocks


def _below(node: TreeNode) -> list[TreeNode]:
    return [n for child in node.children for n in (child, *_below(child))]


@dataclass(frozen=True)
class GraphNode:
    """An object of the dependency graph, drawn as a box.

    Attributes:
        index: index of the object.
        column: least number of objects that are placed before it.
        row: its place among those of its column.
    """

    index: int
    column: int
    row: int


def graph_nodes(edges: Sequence[tuple[int, int]], count: int) -> list[GraphNode]:
    """Puts each object to the right of all that are placed before it.

    Args:
        edges: (i, j): object i before object j, without a cycle.
        count: number of objects.
    """
    graph: nx.DiGraph = nx.DiGraph()
    graph.add_nodes_from(range(count))
    graph.add_edges_from(edges)
    return [
        GraphNode(index, column, row)
        for column, layer in enumerate(nx.topological_generations(graph))
        for row, index in enumerate(sorted(layer))
    ]
