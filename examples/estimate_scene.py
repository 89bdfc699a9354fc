# SPDX-License-Identifier: MIT
"""Estimates one image of a dataset and hands the scene to Drake.

    python examples/estimate_scene.py

Writes below out/example: the overlay, and model directives that put the estimated
objects into any MultibodyPlant.
"""

from __future__ import annotations

from pathlib import Path

from physim_drake.datasets.bop import BopDataset
from physim_drake.datasets.detections import load_detections
from physim_drake.estimation import EstimationConfig, estimate_scene
from physim_drake.models import APC11
from physim_drake.objects import ObjectLibrary
from physim_drake.rendering.overlay import draw_overlay, write_png


def main(
    dataset_folder: Path = Path(__file__).parent / "data" / "tabletop",
    out: Path = Path("out/example"),
    config: EstimationConfig = EstimationConfig(workers=2),  # noqa: B008 (frozen)
) -> None:
    """Estimates image 0 of scene 1 of a dataset."""
    dataset = BopDataset(dataset_folder)
    observation = dataset.observation(scene_id=1, im_id=0)
    detections = load_detections(dataset.root / "detections.json", dataset)[1, 0]
    library = ObjectLibrary.load(APC11, {d.object_id for d in detections})

    estimate = estimate_scene(observation, library, detections, config)

    print(estimate)
    out.mkdir(parents=True, exist_ok=True)
    write_png(out / "overlay.png", draw_overlay(observation, estimate, library))
    print(estimate.to_model_directives(library, out / "scene"))


# More than one worker means processes, and those import this file again.
if __name__ == "__main__":
    main()
