# SPDX-License-Identifier: MIT
"""Estimates the example scene, compares with the truth and draws an overlay.

python examples/compare_with_truth.py --out out/example
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from physim_drake.datasets.bop import BopDataset
from physim_drake.datasets.detections import load_detections
from physim_drake.estimation import EstimationConfig, estimate_scene
from physim_drake.models import APC11
from physim_drake.objects import ObjectLibrary
from physim_drake.parallel.cores import default_workers
from physim_drake.pose_errors import pose_error
from physim_drake.poses import Array
from physim_drake.rendering.overlay import draw_overlay, write_png
from physim_drake.scene_estimate import SceneEstimate
from physim_drake.search.group_search import SearchConfig

DATASET = Path(__file__).parent / "data" / "tabletop"


def main() -> None:
    """Estimates the example scene."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/example"))
    parser.add_argument("--expansions", type=int, default=250)
    arguments = parser.parse_args()
    dataset = BopDataset(DATASET)
    observation = dataset.observation(1, 0)
    detections = load_detections(DATASET / "detections.json", dataset)[1, 0]
    library = ObjectLibrary.load(APC11, {d.object_id for d in detections})
    config = EstimationConfig(
        workers=default_workers(), search=SearchConfig(arguments.expansions)
    )
    print(f"estimating {len(detections)} objects, about half a minute")
    estimate = estimate_scene(observation, library, detections, config)
    truth = {g.object_id: g.X_CO for g in dataset.ground_truth(1, 0)}
    Console(width=96).print(errors_table(estimate, truth, library))
    arguments.out.mkdir(parents=True, exist_ok=True)
    path = arguments.out / "overlay.png"
    write_png(path, draw_overlay(observation, estimate, library))
    print(f"the overlay is in {path.resolve()}")


def errors_table(
    estimate: SceneEstimate, truth: dict[int, Array], library: ObjectLibrary
) -> Table:
    """Poses in the world, and how far they are from the truth."""
    table = Table(title=f"{estimate.method}, {estimate.seconds:.1f} s", box=None)
    for heading in ("object", "x, y, z (m)", "confidence", "off by mm", "off by deg"):
        table.add_column(heading, justify="left" if heading == "object" else "right")
    for item in estimate.objects:
        if item.X_CO is None or item.X_WO is None:
            table.add_row(item.name, "not found", "-", "-", "-")
            continue
        symmetry = library[item.object_id].symmetry
        error = pose_error(truth[item.object_id], item.X_CO, symmetry)
        table.add_row(
            item.name,
            ", ".join(f"{x:.4f}" for x in item.X_WO[:3, 3]),
            f"{item.confidence:.2f}",
            f"{error.translation * 1e3:.2f}",
            f"{np.degrees(error.geodesic):.2f}",
        )
    return table


if __name__ == "__main__":
    main()
