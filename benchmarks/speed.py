# SPDX-License-Identifier: MIT
"""How long an estimate takes, where the time goes, and how it grows with the scene.

    python benchmarks/speed.py [DATASET] [--image S/I] [--repeats 5] [--json FILE]
        [--objects 1,3,6,12,20] [--piles 5,10] [--workers 1,2] [--search plain]

Without a dataset, the bundled example image is used. Then scenes of so many objects
are generated, once spread over the table and once in a pile, and estimated whole.
Spread ones are compared with three objects at a time, of the same image (`to 3`).
Every figure is a median over the repeats, after one run that warms caches and compiles
kernels. Memory is the peak of the main process and of the largest worker.
"""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import statistics
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from physim_drake.batch.detection_source import DetectionSource, match_detections
from physim_drake.batch.image_names import choose_images
from physim_drake.datasets.bop import BopDataset
from physim_drake.estimation.estimator import EstimationConfig, PoseEstimator
from physim_drake.estimation.workers import Worker, WorkerConfig
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.observation.segmented_scene import prepare_scene
from physim_drake.observation.support_surface import find_support_surface
from physim_drake.scene_estimate import SceneEstimate
from physim_drake.search.dependency import dependency_graph
from physim_drake.search.expansion import Rollout
from physim_drake.testing import ObservedScene, compare_poses, observed_scene

EXAMPLE = Path(__file__).parents[1] / "examples" / "data" / "tabletop"
_ROLLOUTS = 20
_SEEDS = 10
_COLUMNS = (
    *("", "objects", "groups", "workers", "s", "to 3", "to 1 worker", "hypotheses s"),
    *("search s", "refinement s", "expansions", "deg", "mm", "5 deg 1 cm"),
)
_MISSING = 60.0, 1.0  # degrees and m that a missing object counts


class Search(StrEnum):
    """Which settings of the search."""

    DEFAULT = "default"
    PLAIN = "plain"


def main(
    dataset: Annotated[Path, typer.Argument()] = EXAMPLE,
    image: str = "",
    models: Path | None = None,
    repeats: int = 5,
    objects: Annotated[
        str, typer.Option(help="Numbers of objects apart; empty for none.")
    ] = "1,2,3,6,12,20",
    piles: Annotated[str, typer.Option(help="Numbers of objects in a pile.")] = "5,10",
    workers: Annotated[str, typer.Option(help="Numbers of processes.")] = "1,2",
    search: Annotated[
        Search, typer.Option(help="plain: the paper's, without an early stop.")
    ] = Search.DEFAULT,
    seed: Annotated[int, typer.Option(help="Of the generated scenes.")] = 0,
    json_file: Annotated[Path | None, typer.Option("--json")] = None,
) -> None:
    """Times the stages on one core, and whole images."""
    bop = BopDataset(dataset)
    targets = bop.targets()
    chosen = choose_images(targets, [image] if image else [])[0]
    source = DetectionSource.default(bop)
    detections = match_detections(targets, chosen, source.look_up(chosen), bop)
    folder = models or (APC11 if dataset == EXAMPLE else bop.models)
    library = ObjectLibrary.load(folder, {d.object_id for d in detections})
    observation = bop.observation(*chosen)
    config = configuration(search)
    processes = _numbers(workers)

    console = Console(width=None if sys.stdout.isatty() else 140)
    stages = {
        "objects": len(detections),
        **_stages(library, observation, detections, repeats),
    }
    worker_memory = 0.0
    for count in processes:
        config = replace(config, workers=count)
        runs, memory = _runs(library, config, observation, detections, repeats)
        worker_memory = max(worker_memory, memory)
        stages |= {f"{name}_{count}w": x for name, x in _image_figures(runs).items()}
    table = Table("figure", "median", title=f"{dataset.name} {chosen[0]}/{chosen[1]}")
    for name, value in stages.items():
        table.add_row(name.replace("_", " "), f"{value:.4g}")
    console.print(table)

    wanted = [("apart", n) for n in _numbers(objects)]
    wanted += [("pile", n) for n in _numbers(piles)]
    everything = ObjectLibrary.load(APC11)
    rows = []
    for kind, number in wanted:
        scene = _draw_scene(everything, kind, number, seed)
        for count in processes:
            config = replace(config, workers=count)
            rows.append(_scene_row(kind, scene, everything, config, repeats))
            worker_memory = max(worker_memory, rows[-1]["worker_memory_mb"])
    if rows:
        console.print(_scene_table(rows))
    main_memory = _peak_memory(os.getpid())
    console.print(
        f"peak memory: main {main_memory:.0f} MB, a worker {worker_memory:.0f} MB"
    )
    if json_file:
        report = {
            "search": search,
            "repeats": repeats,
            **stages,
            "main_memory_mb": main_memory,
            "worker_memory_mb": worker_memory,
            "scenes": rows,
        }
        json_file.write_text(json.dumps(report, indent=1) + "\n")


def configuration(search: Search) -> EstimationConfig:
    """The default settings, or the search of the paper: all 250 expansions, once."""
    return EstimationConfig.paper() if search is Search.PLAIN else EstimationConfig()


def _numbers(text: str) -> list[int]:
    return [int(word) for word in text.split(",") if word]


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
            for _ in range(_ROLLOUTS):
                steps = [
                    (k, h.poses[generator.integers(len(h.poses))])
                    for k, h in enumerate(found)
                ]
                worker.rollout(Rollout((), tuple(steps)))
            per_rollout = (time.perf_counter() - start) / _ROLLOUTS
            expansions.append(per_rollout / len(found))
    return {
        "scored_poses_an_object": statistics.median(len(h.X_SO) for h in found),
        "hypotheses_s_an_object": statistics.median(hypotheses),
        "expansion_ms": 1000 * statistics.median(expansions),
    }


def _runs(
    library: ObjectLibrary,
    config: EstimationConfig,
    observation: RgbdObservation,
    detections: Sequence[Detection],
    repeats: int,
) -> tuple[list[SceneEstimate], float]:
    """Estimates of one image by warm workers, and the most memory of one, MB."""
    with PoseEstimator(library, config) as estimator:
        estimator.estimate(observation, detections)
        runs = [estimator.estimate(observation, detections) for _ in range(repeats)]
        workers = multiprocessing.active_children()
        return runs, max((_peak_memory(w.pid) for w in workers), default=0.0)


def _peak_memory(pid: int | None) -> float:
    """Of a process, MB. What the kernel tells of children counts their parent's."""
    status = Path(f"/proc/{pid}/status").read_text()
    (line,) = (x for x in status.splitlines() if x.startswith("VmHWM:"))
    return int(line.split()[1]) / 1024


def _image_figures(runs: Sequence[SceneEstimate]) -> dict[str, float]:
    figures = {"image_s": statistics.median(run.seconds for run in runs)}
    for stage in runs[0].stages:
        figures[f"{stage}_s"] = statistics.median(run.stages[stage] for run in runs)
    figures["expansions"] = sum(trace.expansions for trace in runs[0].trace)
    return figures


def _draw_scene(
    library: ObjectLibrary, kind: str, number: int, seed: int
) -> ObservedScene:
    """A pile; or objects apart, from the seeds on that part them best in the image.

    Objects that stand apart may still overlap in the image, and are then searched
    together. So there are half as many more, and as many are looked for as overlap
    none of the others; of those seeds, the one with most.
    """
    if kind == "pile":
        return observed_scene(library, number, seed, (number, number))
    best: ObservedScene | None = None
    for n in range(_SEEDS):
        placed = number + number // 2
        scene = observed_scene(library, 1, seed + n, (placed, placed))
        wanted = _independent(scene)[:number]
        if best is None or len(wanted) > len(best.detections):
            best = _part(scene, wanted)
        if len(wanted) == number:
            break
    assert best is not None, "there are seeds"
    return best


def _independent(scene: ObservedScene) -> list[int]:
    """Objects of a scene of which each is searched alone, the least hidden first."""
    surface = find_support_surface(scene.observation, scene.detections)
    prepared = prepare_scene(scene.observation, surface, scene.detections)
    found: list[int] = []
    shown = [truth.visible_fraction or 0.0 for truth in scene.ground_truth]
    for k in np.argsort(-np.array(shown), kind="stable").tolist():
        pairs = ([prepared.segments[k], prepared.segments[j]] for j in found)
        if all(len(dependency_graph(p, prepared.X_CS).components) == 2 for p in pairs):
            found.append(k)
    return found


def _part(scene: ObservedScene, wanted: Sequence[int]) -> ObservedScene:
    """The same image, of which only some objects are looked for."""
    return replace(
        scene,
        detections=tuple(scene.detections[k] for k in wanted),
        ground_truth=tuple(scene.ground_truth[k] for k in wanted),
    )


def _scene_row(
    kind: str,
    scene: ObservedScene,
    library: ObjectLibrary,
    config: EstimationConfig,
    repeats: int,
) -> dict[str, Any]:
    """Times a generated scene; and what comes out, since speed alone is worth little.

    A missing object counts as 60 degrees and 1 m off.
    """
    number = len(scene.detections)
    runs, memory = _runs(library, config, scene.observation, scene.detections, repeats)
    compared = compare_poses(runs[0], scene.ground_truth, library)
    degrees = [
        _MISSING[0] if c.rotation_deg is None else c.rotation_deg for c in compared
    ]
    metres = [_MISSING[1] if c.translation is None else c.translation for c in compared]
    return {
        "kind": kind,
        "objects": number,
        "workers": config.workers,
        "groups": len({frozenset(trace.indices) for trace in runs[0].trace}),
        "threes_s": _threes(kind, scene, library, config, repeats),
        **_image_figures(runs),
        "worker_memory_mb": memory,
        "rotation_median_deg": statistics.median(degrees),
        "translation_median_mm": 1000 * statistics.median(metres),
        "within_5deg_1cm": sum(c.within(5.0, 0.01) for c in compared) / number,
    }


def _threes(
    kind: str,
    scene: ObservedScene,
    library: ObjectLibrary,
    config: EstimationConfig,
    repeats: int,
) -> float | None:
    """Seconds for three objects of a scene, the mean over all of it, three by three."""
    number = len(scene.detections)
    if kind == "pile" or number % 3:
        return None
    medians = []
    for k in range(0, number, 3):
        three = _part(scene, range(k, k + 3))
        runs, _ = _runs(library, config, three.observation, three.detections, repeats)
        medians.append(statistics.median(run.seconds for run in runs))
    return statistics.mean(medians)


def _scene_table(rows: Sequence[dict[str, Any]]) -> Table:
    table = Table(title="generated scenes")
    for name in _COLUMNS:
        table.add_column(name, justify="right")
    seconds = {(r["kind"], r["objects"], r["workers"]): r["image_s"] for r in rows}
    for row in rows:
        alone = seconds.get((row["kind"], row["objects"], 1))
        values = [
            row["image_s"],
            row["image_s"] / row["threes_s"] if row["threes_s"] else math.nan,
            alone / row["image_s"] if alone else math.nan,
            row["hypotheses_s"],
            row["search_s"],
            row["refinement_s"],
            row["expansions"],
            row["rotation_median_deg"],
            row["translation_median_mm"],
            row["within_5deg_1cm"],
        ]
        table.add_row(
            row["kind"],
            str(row["objects"]),
            str(row["groups"]),
            str(row["workers"]),
            *(f"{value:.3g}" for value in values),
        )
    return table


if __name__ == "__main__":
    typer.run(main)
