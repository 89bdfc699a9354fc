# SPDX-License-Identifier: MIT
"""The command: python -m benchmarks.peers --help."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated, Any

os.environ["OMP_NUM_THREADS"] = "1"  # before a library starts threads

import typer
from rich.console import Console
from rich.status import Status

from benchmarks.peers import drawn_segments, stages, tables
from benchmarks.peers.cases import PartOfDataset, generated_dataset, image_cases
from benchmarks.peers.installed import HOW, missing
from benchmarks.peers.registration import registrations
from benchmarks.peers.scene_level import scene_rows
from benchmarks.peers.settling import engines
from physim_drake.batch.detection_source import DetectionSource
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary
from physim_drake.reporting.study import SUCCESS_CM, SUCCESS_DEG
from physim_drake.storage.files import write_atomically

PARTS = ("registration", "refinement", "settle", "scene")
REFINED_FROM = (8.0, 0.010)  # degrees and metres off
SETTLED_FROM = (3.0, 0.005)
LIMITS = (SUCCESS_DEG, SUCCESS_CM)
DRAWN_LIMITS = (drawn_segments.SUCCESS_DEG, drawn_segments.SUCCESS_CM)


def main(
    dataset: Annotated[
        Path | None,
        typer.Option(
            help="With ground truth, of the bundled objects where it has no models; "
            "scenes are generated without it."
        ),
    ] = None,
    limit: Annotated[
        int, typer.Option(min=0, help="Only so many images and drawn segments; 0: all.")
    ] = 0,
    only: Annotated[
        list[str] | None, typer.Option(help=f"Of {', '.join(PARTS)}; again for more.")
    ] = None,
    scenes: Annotated[int, typer.Option(min=1, help="Generated without DIR.")] = 12,
    seed: Annotated[int, typer.Option(min=0, help="Of what is generated.")] = 0,
    masks: Annotated[bool, typer.Option(help="Segments by masks, not boxes.")] = False,
    repeats: Annotated[int, typer.Option(min=1, help="Of each case.")] = 3,
    json_file: Annotated[Path | None, typer.Option("--json")] = None,
) -> None:
    """Compares with Open3D, OpenCV, small_gicp, MuJoCo and PyBullet.

    All on one core, in seconds of the processor; medians over cases and repeats.
    """
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = 160
    for name in missing():
        console.print(f"{name} is not installed and left out; {HOW}")
    chosen = tuple(only or PARTS)
    if unknown := set(chosen) - set(PARTS):
        raise typer.BadParameter(f"{', '.join(sorted(unknown))} of {', '.join(PARTS)}")
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    root = dataset or generated_dataset(Path("out/peers"), scenes, seed)
    with console.status("") as status:
        report = compare(root, limit, chosen, seed, masks, repeats, console, status)
    if json_file:
        with write_atomically(json_file) as file:
            json.dump(report, file, indent=1)
            file.write("\n")


def compare(
    root: Path,
    limit: int,
    parts: tuple[str, ...],
    seed: int,
    masks: bool,
    repeats: int,
    console: Console,
    status: Status,
) -> dict[str, Any]:
    """Runs the parts and prints a table for each; all of it for JSON."""
    own = root / "models"
    part = PartOfDataset(root, limit, own if own.is_dir() else APC11)
    make = DetectionSource.masks if masks else DetectionSource.default
    source = make(part)
    library = ObjectLibrary.load(part.models, {t.object_id for t in part.targets()})
    by_image = {
        image: image_cases(part, library, image, source.look_up, source.name)[2]
        for image in part.chosen
    }
    cases = [case for of_image in by_image.values() for case in of_image]
    found = f"{root.name}: {len(cases)} segments of {len(by_image)} images"
    methods = registrations()
    report: dict[str, Any] = {
        "dataset": root.name,
        "images": len(by_image),
        "segments": len(cases),
        "repeats": repeats,
        "missing": missing(),
    }
    if "registration" in parts:
        records = stages.register(methods, cases, LIMITS, repeats, status.update)
        report["registration"] = _registration(console, found, records)
        drawn = drawn_segments.drawn_cases(ObjectLibrary.load(APC11), limit, seed)
        records = stages.register(methods, drawn, DRAWN_LIMITS, repeats, status.update)
        title = f"{len(drawn)} drawn segments, success within 10 deg, 1.5 cm"
        report["drawn registration"] = _registration(console, title, records)
        report["quoted"] = _quoted(console, report["drawn registration"]["rows"][0])
    if "refinement" in parts:
        status.update("refinement")
        rows = stages.refine(cases, REFINED_FROM, LIMITS, repeats)
        report["refinement"] = rows
        tables.show(console, f"Refining from 8 deg, 10 mm; {found}", rows)
    if "settle" in parts:
        rows = stages.settle(
            engines(), cases, SETTLED_FROM, LIMITS, repeats, status.update
        )
        report["settle"] = rows
        tables.show(console, f"Settling from 3 deg, 5 mm off; {found}", rows)
    if "scene" in parts:
        rows = scene_rows(
            part,
            library,
            (source.look_up, source.name),
            by_image,
            methods,
            status.update,
        )
        report["scene"] = rows
        tables.show(console, f"Whole scenes; {found}", rows)
    return report


def _registration(
    console: Console, title: str, records: list[stages.Record]
) -> dict[str, Any]:
    rows, objects = stages.registration_rows(records), stages.object_rows(records)
    note = (
        "best: the first pose; +ICP: the same refined; any: one of the poses that it "
        "gives (ours: of the representatives); deg, cm: medians after ICP.\n"
    )
    tables.show(console, f"Registration; {title}", rows, note)
    tables.show(
        console, "The same by object, after ICP; wins : losses of physim-drake", objects
    )
    return {"rows": rows, "objects": objects, "records": records}


def _quoted(console: Console, ours: tables.Row) -> list[tables.Row]:
    rows: list[tables.Row] = [
        {
            "method": name,
            "best %": 100 * best / 72,
            "+ICP %": 100 * refined / 72,
            "s": seconds,
            "+ICP, ratio": tables.ratio(100 * refined / 72, ours["+ICP %"]),
            "s, ratio": tables.ratio(seconds, ours["s"]),
        }
        for name, seconds, best, refined in drawn_segments.QUOTED
    ]
    note = (
        "Measured earlier on 72 segments of this kind; ratios are to the table above."
    )
    tables.show(console, "Quoted, not run here", rows, note)
    return rows


if __name__ == "__main__":
    typer.run(main)
