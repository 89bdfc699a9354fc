# SPDX-License-Identifier: MIT
"""`physim-drake explain`: one image's way through the estimate, as a page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from physim_drake.cli.options import (
    Dataset,
    DatasetModels,
    Detections,
    Expansions,
    Hypotheses,
    LogLevel,
    Masks,
    Quiet,
    Seed,
    Split,
    Surface,
    Targets,
    Workers,
    surface_height,
)
from physim_drake.cli.output import LogLevelName, messages
from physim_drake.extras import need_extra
from physim_drake.parallel.cores import default_workers


def explain(
    dataset: Dataset,
    image: Annotated[
        str,
        typer.Option(
            metavar="SCENE/IMAGE",
            help="The image to explain, as in 1/0.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            metavar="DIR",
            help="Folder for the page, which is named after the image.",
            show_default=False,
        ),
    ],
    split: Split = "test",
    models: DatasetModels = None,
    detections: Detections = None,
    masks: Masks = False,
    targets: Targets = None,
    surface: Surface = "auto",
    expansions: Expansions = 250,
    hypotheses: Hypotheses = 25,
    workers: Workers = None,
    seed: Seed = 0,
    quiet: Quiet = False,
    log_level: LogLevel = LogLevelName.WARNING,
) -> None:
    """Show how the poses of one image are found, stage by stage, on one HTML page.

    The page needs no server and no other file. It shows what the camera saw, the
    surface, the segments, the hypotheses and their scores, which object is placed
    before which, the search, and for each object how far the image confirms it, or why
    it was not found.
    If the true poses are known, it says at which stage an error arose. The same
    options give the poses that `estimate` gives.

    Example: `physim-drake explain datasets/lab --image 1/3 --out explained`
    """
    need_extra("viz")

    from physim_drake.batch.image_names import choose_images
    from physim_drake.cli.detections import detection_source
    from physim_drake.cli.progress import Steps
    from physim_drake.datasets.bop import BopDataset
    from physim_drake.estimation.estimator import EstimationConfig
    from physim_drake.objects.model import ObjectLibrary
    from physim_drake.reporting.explanation import explain_image
    from physim_drake.reporting.explanation_page import write_explanation
    from physim_drake.storage.files import check_writable, make_folder

    height = surface_height(surface)
    data = BopDataset(dataset, split, models)
    wanted = data.targets(targets)
    (chosen,) = choose_images(wanted, [image], "--image")
    of_image = [t for t in wanted if (t.scene_id, t.im_id) == chosen]
    source = detection_source(data, detections, masks, targets=of_image)
    library = ObjectLibrary.load(data.models, {t.object_id for t in of_image})
    config = EstimationConfig(seed=seed, workers=workers or default_workers())
    config = config.with_budget(expansions, hypotheses)
    make_folder(out)
    check_writable(out / "page.html")
    with Steps(messages(quiet), "step", 3) as steps:
        steps.begin(0, "making hypotheses")
        explanation = explain_image(
            data,
            chosen,
            source.look_up,
            source.name,
            library,
            config,
            height,
            wanted,
            steps.advance,
        )
        steps.advance("drawing")
        path = write_explanation(explanation, out)
    typer.echo(path)
