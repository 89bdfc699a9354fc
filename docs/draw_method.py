# SPDX-License-Identifier: MIT
"""Draws the pictures of docs/how-it-works.md from the example scene.

python docs/draw_method.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from physim_drake.batch.detection_source import DetectionSource
from physim_drake.datasets.bop import BopDataset
from physim_drake.estimation.estimator import EstimationConfig
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary
from physim_drake.rendering.depth import DepthRenderer
from physim_drake.reporting.explanation import Explanation, explain_image
from physim_drake.reporting.explanation_figures import (
    anytime_curve,
    score_histogram,
    tree_blocks,
)
from physim_drake.reporting.explanation_pictures import Pictures
from physim_drake.reporting.html import page_style, svg

DATASET = Path(__file__).parents[1] / "examples" / "data" / "tabletop"
IMAGE = (1, 0)
OUT = Path(__file__).parent / "images" / "method"


def explanation() -> Explanation:
    """Of the example image, with the settings that `estimate` has."""
    data = BopDataset(DATASET, models=APC11)
    source = DetectionSource.default(data)
    library = ObjectLibrary.load(APC11, {t.object_id for t in data.targets()})
    config = EstimationConfig(workers=2)
    return explain_image(data, IMAGE, source.look_up, source.name, library, config)


def draw_images(pictures: Pictures, shown: int) -> None:
    """What is drawn over the image, as WebP."""
    images = {
        "detections": pictures.detections(),
        "surface": pictures.surface(),
        "heights": pictures.heights(),
        "segments": pictures.segments(),
        "hypotheses": pictures.hypotheses(shown),
        "estimate": pictures.estimate(),
        "residuals": pictures.residuals,
    }
    for name, image in images.items():
        Image.fromarray(np.asarray(image)).save(
            OUT / f"{name}.webp", quality=80, method=6
        )


def draw_diagrams(e: Explanation, shown: int) -> None:
    """What matplotlib draws, as SVG."""
    (record, *_) = e.searches
    inside = np.any([e.scene.segments[k].mask for k in record.order], axis=0)
    diagrams = {
        "scores": score_histogram(e, shown),
        "curve": anytime_curve(record, (), int(np.count_nonzero(inside))),
        "tree": tree(e),
    }
    spaces = 'xmlns="http://www.w3.org/2000/svg" '
    spaces += 'xmlns:xlink="http://www.w3.org/1999/xlink"'
    for name, text in diagrams.items():
        file = str(text).replace("<svg ", f"<svg {spaces} ", 1)
        (OUT / f"{name}.svg").write_text(f"{file}\n", encoding="utf-8")


def tree(e: Explanation) -> str:
    """The search tree: a row an object, a block a hypothesis, as wide as its visits."""
    (record, *_) = e.searches
    blocks = tree_blocks(record, e.names)
    rows = len(record.order)
    reached = {block.row for block in blocks}
    with page_style():
        figure = Figure(figsize=(7.0, 0.2 + 0.5 * rows))
        axes = figure.add_axes((0.0, 0.02, 1.0, 0.96))
        for block in blocks:
            axes.broken_barh(
                [(block.x, block.width)],
                (-block.row, 0.6),
                facecolor=block.color,
                edgecolor="#d62728" if block.best else "white",
                linewidth=1.6 if block.best else 0.3,
                zorder=2 if block.best else 1,
            )
        for row in range(rows):
            name = e.names[record.order[row]]
            name += "" if row in reached else ": not reached, placed at random"
            axes.text(0.0, 0.66 - row, name, fontsize=9)
        axes.set_xlim(0, 1)
        axes.set_ylim(0.9 - rows, 1.0)
        axes.axis("off")
        return svg(figure, "The tree of a search")


def main() -> None:
    """Draws all pictures."""
    OUT.mkdir(parents=True, exist_ok=True)
    e = explanation()
    models = {d.object_id: e.library[d.object_id] for d in e.detections}
    pictures = Pictures(e, DepthRenderer(models, e.observation.intrinsics))
    shown = e.searches[0].order[-1]
    draw_images(pictures, shown)
    draw_diagrams(e, shown)
    for k, h in enumerate(e.hypotheses):
        print(e.names[k], len(h.X_SO), "poses,", len(h.representatives), "kept")
    (record, *_) = e.searches
    print([e.names[k] for k in record.order], record.result.expansions, "expansions")
    print(e.estimate)


if __name__ == "__main__":
    main()
