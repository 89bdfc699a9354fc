# SPDX-License-Identifier: MIT
"""How long an estimate takes, and where the time goes.

    python benchmarks/speed.py [DATASET] [--image S/I] [--repeats 5] [--json FILE]

Without a dataset, the bundled example scene is used. Every figure is a median over the
repeats, after one run that warms caches and compiles kernels.
"""

from __future__ import annotations

import json
import resource
import statistics
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from physim_drake.batch import choose_images, detection_lookup, match_detections
from physim_drake.datasets.bop import BopDataset
from physim_drake.estimation import EstimationConfig, PoseEstimator
from physim_drake.models import APC11
from physim_drake.objects import ObjectLibrary
from physim_drake.observation import Detection, RgbdObservation
from physim_drake.scene import prepare_scene
from physim_drake.search.expansion import Rollout
from physim_drake.surface import find_support_surface
from physim_drake.workers import Worker, WorkerConfig

EXAMPLE = Path(__file__).parents[1] / "examples" / "data" / "tabletop"


def main(
    dataset: Annotated[Path, typer.Argument()] = EXAMPLE,
    image: str = "",
    models: Path | None = None,
    repeats: int = 5,
    json_file: Annotated[Path | None, typer.Option("--json")] = None,
) -> None:
    """Times the stages on one core, and whole images on one and two."""
    bop = BopDataset(dataset)
    targets = bop.targets()
    chosen = choose_images(targets, [image] if image else [])[0]
    look_up, source = detection_lookup(bop)
    detections = match_detections(targets, chosen, look_up(chosen), source)
    folder = models or (APC11 if dataset == EXAMPLE else bop.models)
    library = ObjectLibrary.load(folder, {d.object_id for d in detections})
    observation = bop.observation(*chosen)

    figures = {
        "objects": len(detections),
        **_stages(library, observation, detections, repeats),
        **_images(library, observation, detections, repeats),
    }
    usage = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    figures["main_memory_mb"] = usage / 1024
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    figures["worker_memory_mb"] = children / 1024
    table = Table("figure", "median", title=f"{dataset.name} {chosen[0]}/{chosen[1]}")
    for name, value in figures.items():
        table.add_row(name.replace("_", " "), f"{value:.4g}")
    Console().print(table)
    if json_file:
        json_file.write_text(json.dumps(figures, indent=1) + "\n")


def _stages(
    library: ObjectLibrary,
    observation: RgbdObservation,
    detections: list[Detection],
    repeats: int,
) -> dict[str, float]:
    """Seconds an object and milliseconds an expansion, on one thread."""
    surface = find_support_surface(observation, detections)
    scene = prepare_scene(observation, surface, detections)
    worker = Worker(library, WorkerConfig())
    with threadpool_limits(1):
        worker.set_scene(scene)
        found = [worker.hypotheses(k, {}, (0, k)) for k in range(len(detections))]
        hypotheses, expansions = [], []
        for repeat in range(repeats):
            for k in range(len(detections)):
                start = time.perf_counter()
                worker.hypotheses(k, {}, (repeat, k))
                hypotheses.append(time.perf_counter() - start)
            generator = np.random.default_rng(repeat)
            start = time.perf_counter()
            for _ in range(20):
                steps = [
                    (k, h.poses[generator.integers(len(h.poses))])
                    for k, h in enumerate(found)
                ]
                worker.rollout(Rollout((), tuple(steps)))
            per_rollout = (time.perf_counter() - start) / 20
            expansions.append(per_rollout / len(found))
    return {
        "scored_poses_an_object": statistics.median(len(h.X_SO) for h in found),
        "hypotheses_s_an_object": statistics.median(hypotheses),
        "expansion_ms": 1000 * statistics.median(expansions),
    }


def _images(
    library: ObjectLibrary,
    observation: RgbdObservation,
    detections: list[Detection],
    repeats: int,
) -> dict[str, float]:
    """Seconds a whole image at the default budget, by number of workers and stage."""
    figures: dict[str, Any] = {}
    for workers in (1, 2):
        config = replace(EstimationConfig(), workers=workers)
        with PoseEstimator(library, config) as estimator:
            estimator.estimate(observation, detections)
            runs = [estimator.estimate(observation, detections) for _ in range(repeats)]
        label = f"{workers}_worker{'s' if workers > 1 else ''}"
        figures[f"image_s_{label}"] = statistics.median(run.seconds for run in runs)
        for stage in runs[0].stages:
            seconds = statistics.median(run.stages[stage] for run in runs)
            figures[f"image_s_{label}_{stage}"] = seconds
        expansions = sum(trace.expansions for trace in runs[0].trace)
        figures["expansions_an_image"] = expansions
    return figures


if __name__ == "__main__":
    typer.run(main)
