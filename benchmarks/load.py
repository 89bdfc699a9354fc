# SPDX-License-Identifier: MIT
"""Memory over one long `physim-drake estimate`, and what a large library costs.

    python benchmarks/load.py [--images 1000] [--workers 2] [--objects 0]
        [--json FILE] [--plot FILE] [--work FOLDER]

The bundled example image is repeated by links, so that every image asks for the same
work. The memory of the main process and of each worker is read from /proc while they
run, shared pages divided among those that share them. It is flat when the last quarter
of the images needs no more than 3 % over what is needed from the 20th image on.
With --objects the library is filled up with so many copies of the bundled objects.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from physim_drake.models import APC11
from physim_drake.objects.library_files import find_objects

EXAMPLE = Path(__file__).parents[1] / "examples" / "data" / "tabletop"
WARM_IMAGES = 20
MAX_GROWTH = 0.03
_PERIOD = 0.5  # s between samples


@dataclass(frozen=True)
class Sample:
    """Memory at one moment.

    Attributes:
        seconds: time since the start.
        images: number of images done.
        main_mb: memory of the main process, MB.
        workers_mb: memory of all its children together, MB.
    """

    seconds: float
    images: int
    main_mb: float
    workers_mb: float

    @property
    def total(self) -> float:
        """Of all processes, MB."""
        return self.main_mb + self.workers_mb


def main(
    images: int = 1000,
    workers: int = 2,
    objects: int = 0,
    expansions: int = 250,
    json_file: Annotated[Path | None, typer.Option("--json")] = None,
    plot: Path | None = None,
    work: Path | None = None,
) -> None:
    """Runs one estimate and samples its memory."""
    figures, samples = measure(images, workers, objects, expansions, work)
    print(json.dumps(figures, indent=1))
    if json_file:
        rows = [[s.seconds, s.images, s.main_mb, s.workers_mb] for s in samples]
        figures["samples"] = [[round(x, 2) for x in row] for row in rows]
        json_file.write_text(json.dumps(figures) + "\n")
    if plot:
        draw(samples, plot)
    raise typer.Exit(figures["exit_status"] != 0 or figures["flat"] is False)


def measure(
    images: int,
    workers: int = 2,
    objects: int = 0,
    expansions: int = 250,
    work: Path | None = None,
) -> tuple[dict[str, Any], list[Sample]]:
    """Runs one estimate and samples its memory.

    Args:
        images: number of images to estimate.
        workers: number of processes.
        objects: number of objects that the library is filled up to. 0 leaves it as it
            is.
        expansions: expansions of the search for each image.
        work: folder for intermediate files.

    Returns:
        figures, see `summarise`, and the samples.
    """
    with tempfile.TemporaryDirectory(dir=work) as name:
        folder = Path(name)
        repeat_example(folder / "data", images)
        models = fill_library(folder / "models", objects) if objects else APC11
        progress = folder / "results.csv.progress"
        start = time.monotonic()
        samples, status = watch(
            [
                *("estimate", str(folder / "data"), "--models", str(models)),
                *("--out", str(folder / "results.csv"), "--workers", str(workers)),
                *("--expansions", str(expansions)),
            ],
            progress,
        )
        seconds = time.monotonic() - start
        done = _images_done(progress)
    figures = summarise(samples, images) | {
        "images": done,
        "workers": workers,
        "library": objects or len(find_objects(APC11)),
        "seconds": round(seconds, 1),
        "exit_status": status,
    }
    return figures, samples


def repeat_example(folder: Path, images: int) -> None:
    """Writes a dataset of one scene in which the example's first image is repeated."""
    source = next((EXAMPLE / "test").iterdir())
    scene = folder / "test" / "000001"
    cameras = json.loads((source / "scene_camera.json").read_text())
    first, camera = next(iter(cameras.items()))
    for kind in ("depth", "rgb"):
        (scene / kind).mkdir(parents=True)
        for k in range(images):
            link = scene / kind / f"{k:06d}.png"
            link.symlink_to((source / kind / f"{int(first):06d}.png").resolve())
    every = {str(k): camera for k in range(images)}
    (scene / "scene_camera.json").write_text(json.dumps(every))
    place = {"scene_id": int(source.name)}
    for name, key in (
        ("test_targets_bop19.json", "im_id"),
        ("detections.json", "image_id"),
    ):
        chosen = place | {key: int(first)}
        entries = [
            entry
            for entry in json.loads((EXAMPLE / name).read_text())
            if chosen.items() <= entry.items()
        ]
        repeated = [
            entry | {"scene_id": 1, key: k} for k in range(images) for entry in entries
        ]
        (folder / name).write_text(json.dumps(repeated))


def fill_library(folder: Path, objects: int) -> Path:
    """Writes a library of so many objects: the bundled ones, then copies of them."""
    import yaml

    listed = yaml.safe_load((APC11 / "library.yaml").read_text())["objects"]
    shutil.copytree(APC11, folder)
    entries = []
    for k in range(max(objects, len(listed))):
        entry = dict(listed[k % len(listed)])
        if k >= len(listed):
            entry |= {"id": 1000 + k, "name": f"{entry['name']}_{k}"}
        entries.append(entry)
    (folder / "library.yaml").write_text(yaml.safe_dump({"objects": entries}))
    return folder


def watch(arguments: list[str], progress: Path) -> tuple[list[Sample], int]:
    """Runs the command line. Returns samples of its memory and its exit status."""
    code = "from physim_drake.cli import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", code, *arguments], stdout=subprocess.DEVNULL
    )
    start, samples = time.monotonic(), []
    # What ends this process ends the run, too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        while process.poll() is None:
            time.sleep(_PERIOD)
            main_mb = _proportional_mb(process.pid)
            workers_mb = sum(map(_proportional_mb, _descendants(process.pid)))
            if main_mb > 0:
                done = _images_done(progress)
                seconds = time.monotonic() - start
                samples.append(Sample(seconds, done, main_mb, workers_mb))
    finally:
        process.terminate()
        status = process.wait()
    return samples, status


def _images_done(progress: Path) -> int:
    try:
        return max(progress.read_bytes().count(b"\n") - 1, 0)
    except OSError:
        return 0


def _descendants(pid: int) -> list[int]:
    parents: dict[int, int] = {}
    for name in os.listdir("/proc"):
        if name.isdigit():
            try:
                text = Path("/proc", name, "stat").read_text()
            except OSError:
                continue
            parents[int(name)] = int(text.rpartition(")")[2].split()[1])
    found, fresh = [], {pid}
    while fresh:
        fresh = {child for child, parent in parents.items() if parent in fresh}
        found += sorted(fresh)
    return found


def _proportional_mb(pid: int) -> float:
    """Memory of a process, shared pages divided among their users. 0 if it is gone."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0.0
    return next((int(x.split()[1]) / 1e3 for x in lines if x.startswith("Pss:")), 0.0)


def summarise(samples: list[Sample], images: int) -> dict[str, Any]:
    """Peaks, and growth from the 20th image to the last quarter of them.

    Args:
        samples: samples in the order of time.
        images: number of images in all.

    Returns:
        figures. ``early_`` are medians from the 20th image to a quarter of them,
        ``late_`` in the last quarter. ``growth`` compares the two for all processes
        together. Figures that need more images, such as ``flat``, are None.
    """
    late_from = max(WARM_IMAGES, images * 3 // 4)
    early_to = max(WARM_IMAGES + 1, images // 4)
    early = [s for s in samples if WARM_IMAGES <= s.images <= early_to]
    late = [s for s in samples if s.images >= late_from]
    figures: dict[str, Any] = {
        "images": samples[-1].images if samples else 0,
        "main_peak_mb": round(max((s.main_mb for s in samples), default=0.0)),
        "workers_peak_mb": round(max((s.workers_mb for s in samples), default=0.0)),
    }
    for name, part in (("early", early), ("late", late)):
        for key in ("main_mb", "workers_mb"):
            median = np.median([getattr(s, key) for s in part]) if part else None
            figures[f"{name}_{key}"] = None if median is None else round(float(median))
    if not early or not late or images < 2 * WARM_IMAGES:
        return figures | {"growth": None, "flat": None}
    before, after = (np.median([s.total for s in part]) for part in (early, late))
    growth = float(after / before - 1)
    return figures | {"growth": round(growth, 4), "flat": growth <= MAX_GROWTH}


def draw(samples: list[Sample], path: Path) -> None:
    """Draws memory over images."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 3.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    images = [s.images for s in samples]
    axes.plot(images, [s.total for s in samples], label="all processes")
    axes.plot(images, [s.workers_mb for s in samples], label="workers together")
    axes.plot(images, [s.main_mb for s in samples], label="main process")
    axes.set(xlabel="images done", ylabel="memory, MB", ylim=(0, None))
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    typer.run(main)
