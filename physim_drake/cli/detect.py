# SPDX-License-Identifier: MIT
"""`physim-drake detect`: where the known objects are in a dataset's images."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from physim_drake.cli.options import (
    Dataset,
    LeastScore,
    LogLevel,
    NetworkWeights,
    Quiet,
    Split,
    Threads,
)
from physim_drake.cli.output import LogLevelName, counted, messages
from physim_drake.extras import need_extra
from physim_drake.models import DETECTOR


def detect(
    dataset: Dataset,
    out: Annotated[
        Path,
        typer.Option(
            metavar="DETECTIONS.json",
            help="File for boxes and masks, in BOP's JSON format.",
            show_default=False,
        ),
    ],
    weights: NetworkWeights = DETECTOR,
    split: Split = "test",
    least_score: LeastScore = 0.05,
    overlays: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder for pictures: boxes, masks and names drawn into the images.",
        ),
    ] = None,
    drawn_score: Annotated[
        float,
        typer.Option(
            min=0.0, max=1.0, help="Detections of a lower score are not drawn."
        ),
    ] = 0.5,
    threads: Threads = None,
    quiet: Quiet = False,
    log_level: LogLevel = LogLevelName.WARNING,
) -> None:
    """Detect the known objects in a dataset's images, with boxes and masks.

    Example: `physim-drake detect datasets/lab --out detections.json --overlays out`
    """
    need_extra("train")

    from physim_drake.cli.progress import Steps
    from physim_drake.datasets.bop import BopDataset
    from physim_drake.detection.detect_images import (
        detect_images,
        target_names,
        write_detections,
    )
    from physim_drake.detection.detector import NetworkDetector
    from physim_drake.detection.drawing import draw_detections
    from physim_drake.rendering.overlay import write_png
    from physim_drake.storage.files import check_writable, make_folder

    data = BopDataset(dataset, split)
    images = data.images()
    detector = NetworkDetector.load(weights, threads)
    detector.check_objects(target_names(data), dataset)
    check_writable(out)
    if overlays is not None:
        make_folder(overlays)
    names = {c.object_id: c.name for c in detector.classes}
    entries, seconds = [], 0.0
    results = detect_images(detector, data, images, least_score)
    with Steps(messages(quiet), "image", len(images)) as steps:
        for result in results:
            entries += result.entries()
            seconds += result.seconds
            if overlays is not None and result.observation.color is not None:
                shown = [d for d in result.detections if d.score >= drawn_score]
                picture = draw_detections(result.observation.color, shown, names)
                scene_id, im_id = result.image
                write_png(overlays / f"{scene_id:06d}_{im_id:06d}.png", picture)
            steps.advance()
    write_detections(out, entries)
    typer.echo(
        f"{counted(len(entries), 'detection')} in {counted(len(images), 'image')}, "
        f"{seconds / len(images):.2f} s an image: {out}"
    )
