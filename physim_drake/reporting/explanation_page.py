# SPDX-License-Identifier: MIT
"""An explanation as one HTML page that needs nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np

from physim_drake.rendering.colors import object_color
from physim_drake.rendering.depth import DepthRenderer
from physim_drake.reporting.explanation import Explanation
from physim_drake.reporting.explanation_figures import (
    anytime_curve,
    graph_nodes,
    pose_map,
    score_histogram,
    tree_blocks,
)
from physim_drake.reporting.explanation_pictures import Pictures
from physim_drake.reporting.explanation_words import (
    RIGHT_DEG,
    RIGHT_MM,
    diagnosis,
    stage_errors,
    verdict,
)
from physim_drake.reporting.html import jpeg, render_page
from physim_drake.scene_estimate import ObjectEstimate
from physim_drake.search.record import SearchRecord
from physim_drake.search.states import Confirmation
from physim_drake.storage.files import write_atomically

_FRAMES = 4  # of the best states over time


def write_explanation(explanation: Explanation, folder: Path) -> Path:
    """Writes the page of an image into a folder.

    Args:
        explanation: explanation of the image.
        folder: it must exist.

    Returns:
        the page, named after its image.

    Raises:
        InputError: if the folder cannot be written.
    """
    scene_id, im_id = explanation.image
    path = folder / f"{scene_id:06d}_{im_id:06d}.html"
    with write_atomically(path) as file:
        file.write(explanation_page(explanation))
    return path


def explanation_page(explanation: Explanation) -> str:
    """The page's text."""
    e = explanation
    models = {d.object_id: e.library[d.object_id] for d in e.detections}
    renderer = DepthRenderer(models, e.observation.intrinsics)
    pictures = Pictures(e, renderer)
    return render_page(
        "explanation.html.j2",
        title=f"Scene {e.image[0]}, image {e.image[1]}: how the poses were found",
        e=e,
        found=sum(o.found for o in e.estimate.objects),
        objects=_objects(e, pictures, renderer),
        overlay=jpeg(pictures.estimate()),
        residuals=jpeg(pictures.residuals),
        detections=jpeg(pictures.detections()),
        depth=jpeg(pictures.depth()),
        surface_picture=jpeg(pictures.surface()),
        heights=jpeg(pictures.heights()),
        surface=_surface(e),
        segments=jpeg(pictures.segments()),
        graph=_graph(e),
        searches=[_search(e, pictures, record) for record in e.searches],
        known_truth=any(X is not None for X in e.truth),
        right_deg=RIGHT_DEG,
        right_mm=RIGHT_MM,
    )


def _objects(
    e: Explanation, pictures: Pictures, renderer: DepthRenderer
) -> list[dict[str, Any]]:
    """What the page tells of each object."""
    told = []
    for k, confirmation in enumerate(e.confirmations(renderer)):
        item, found = e.estimate.objects[k], e.hypotheses[k]
        segment = e.scene.segments[k]
        others = [s.mask for n, s in enumerate(e.scene.segments) if n != k]
        shared = segment.mask & np.any(others, axis=0) if others else segment.mask[:0]
        overlay, residuals = pictures.close_up(k)
        told.append(
            {
                "name": e.names[k],
                "color": "#{:02x}{:02x}{:02x}".format(*object_color(k)),
                "estimate": item,
                "confirmation": confirmation,
                "share": _kept_share(confirmation, item),
                "verdict": verdict(e, k, confirmation),
                "diagnosis": diagnosis(e, k),
                "errors": stage_errors(e, k),
                "pixels": int(np.count_nonzero(segment.mask)),
                "shared": int(np.count_nonzero(shared)),
                "points": len(segment.points),
                "hypotheses": found,
                "nearest": e.nearest_representative(k),
                "outlines": jpeg(pictures.hypotheses(k)) if len(found.X_SO) else None,
                "histogram": score_histogram(e, k) if len(found.X_SO) else None,
                "map": pose_map(e, k) if len(found.X_SO) else None,
                "overlay": jpeg(overlay),
                "residuals": jpeg(residuals),
            }
        )
    return told


def _kept_share(confirmation: Confirmation, item: ObjectEstimate) -> float:
    """Which part of its confidence an object keeps beside other poses of it, 0..1."""
    return item.confidence / max(confirmation.confidence, item.confidence, 1e-9)


def _surface(e: Explanation) -> dict[str, float | None]:
    """Where the support surface lies; angles in degrees, lengths in metres."""
    surface, X_WC = e.estimate.surface, e.observation.X_WC
    tilt = None if X_WC is None else float(np.clip(surface.X_WS[2, 2], -1, 1))
    known = e.scene.depth > 0
    return {
        "height": float(surface.X_SC[2, 3]),
        "slope": 90 - float(np.degrees(np.arccos(np.clip(-surface.X_CS[2, 2], -1, 1)))),
        "share": float(np.mean(e.scene.observed[known] == 0)),
        "tilt": None if tilt is None else float(np.degrees(np.arccos(tilt))),
        "z": None if X_WC is None else round(float(surface.X_WS[2, 3]), 3) + 0.0,
    }


def _graph(e: Explanation) -> dict[str, Any]:
    """The dependency graph, its boxes placed; arrows that others imply are left out."""
    graph: nx.DiGraph = nx.DiGraph(list(e.graph.edges))
    nodes = graph_nodes(e.graph.edges, len(e.detections))
    return {
        "nodes": nodes,
        "edges": sorted(nx.transitive_reduction(graph).edges),
        "columns": 1 + max((n.column for n in nodes), default=0),
        "rows": 1 + max((n.row for n in nodes), default=0),
    }


def _search(e: Explanation, pictures: Pictures, record: SearchRecord) -> dict[str, Any]:
    """What the page tells of the searches of one group."""
    group = set(record.order)
    later = [t for t in e.estimate.trace if set(t.indices) == group][1:]
    inside = np.any([e.scene.segments[k].mask for k in record.order], axis=0)
    pixels = int(np.count_nonzero(inside))
    blocks = tree_blocks(record, e.names)
    return {
        "names": [e.names[k] for k in record.order],
        "record": record,
        "pixels": pixels,
        "curve": anytime_curve(record, later, pixels),
        "blocks": blocks,
        "reached": {block.row for block in blocks},
        "later": later,
        "frames": _frames(e, pictures, record),
    }


def _frames(
    e: Explanation, pictures: Pictures, record: SearchRecord
) -> list[dict[str, Any]]:
    """Some of the best states over time, the first and the last among them."""
    # Several may have come of one round; the last of these is the best.
    points = list({p.expansion: p for p in record.result.trace}.values())
    shown = np.linspace(0, len(points) - 1, min(len(points), _FRAMES)).round()
    return [
        {
            "image": jpeg(pictures.state(record.order, e.scene.X_CS @ point.poses)),
            "expansion": point.expansion,
            "score": point.score,
        }
        for point in (points[int(n)] for n in shown)
    ]
