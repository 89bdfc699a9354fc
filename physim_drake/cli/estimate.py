# SPDX-License-Identifier: MIT
"""`physim-drake estimate`: the poses of all objects in a dataset's images."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from physim_drake.cli.options import (
    Dataset,
    DatasetModels,
    Detections,
    EngineOption,
    Expansions,
    Hypotheses,
    LogLevel,
    Masks,
    Plain,
    Quiet,
    Resume,
    Seed,
    Split,
    Surface,
    Targets,
    Workers,
    surface_height,
)
from physim_drake.cli.output import LogLevelName, messages
from physim_drake.estimation.method import Method
from physim_drake.parallel.cores import default_workers
from physim_drake.parallel.engine import Engine

if TYPE_CHECKING:
    from physim_drake.estimation.config import EstimationConfig


IMAGES_FAILED = 3
"""Exit status if images failed and the others are done."""


class EstimateCommand(TyperCommand):
    """Lets `--images` take several names, as in ``--images 1/0 1/3``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Repeats `--images` before each further name, as the parser wants it."""
        repeated: list[str] = []
        for n, arg in enumerate(args):
            follows = n > 1 and repeated[-2:-1] == ["--images"]
            if follows and re.fullmatch(r"[0-9]+/[0-9]+", arg):
                repeated.append("--images")
            repeated.append(arg)
        return super().parse_args(ctx, repeated)


def estimate(
    dataset: Dataset,
    out: Annotated[
        Path,
        typer.Option(
            metavar="RESULTS.csv",
            help="File for the poses, in BOP's results format: translations in "
            "millimetres, time in seconds of the whole image.",
            show_default=False,
        ),
    ],
    split: Split = "test",
    models: DatasetModels = None,
    detections: Detections = None,
    masks: Masks = False,
    weights: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Take what a network with these weights detects, instead of "
            "detections from a file; physim-drake train writes them.",
        ),
    ] = None,
    boxes: Annotated[
        bool,
        typer.Option(
            "--boxes",
            help="Use only the boxes of the detections, even if they have masks.",
        ),
    ] = False,
    targets: Targets = None,
    surface: Surface = "auto",
    method: Annotated[
        Method,
        typer.Option(
            help="The two physim methods search over all objects together, with "
            "physics; the others take each object alone. fcn-pca-icp takes its "
            "segments from a network."
        ),
    ] = Method.PHYSIM_MCTS,
    expansions: Expansions = 250,
    plain: Plain = False,
    hypotheses: Hypotheses = 25,
    least_confidence: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=1,
            help="Confidence below which an object counts as not found; 0 keeps all.",
            show_default="0.5, or 0 with --plain and with methods that do not search",
        ),
    ] = None,
    workers: Workers = None,
    seed: Seed = 0,
    images: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SCENE/IMAGE ...",
            help="Estimate only these images, as in 1/0 1/3.",
            show_default="all that have targets",
        ),
    ] = None,
    overlays: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder for pictures: each estimate drawn over its image, beside the "
            "depth residuals.",
        ),
    ] = None,
    trace: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder for JSON files that tell how each search went: the best score "
            "by expansion and seconds, and seconds by stage.",
        ),
    ] = None,
    resume: Resume = False,
    engine: EngineOption = Engine.LOCAL,
    quiet: Quiet = False,
    log_level: LogLevel = LogLevelName.WARNING,
) -> None:
    """Estimate the 6D pose of every target object in a dataset's images.

    The poses of an image are consistent with each other and with the surface that the
    objects rest on. An object that has too few points, or whose pose the image does not
    confirm, is reported as not found. The score of a pose is its confidence, from 0 to
    1: the share of what is seen of the model that the depth image confirms to 1 cm,
    times the share of the object's segment that the estimate explains, divided among
    poses that explain the image about as well.

    Results are written image by image. After an error or Ctrl-C the images that are
    done are kept, and `--resume` goes on from there. An image that cannot be used is
    reported as failed, the others are done, and the exit status is 3; `--resume` tries
    failed images again.

    Try, for example:

    `physim-drake estimate datasets/lab --out lab.csv --overlays out/lab`

    `physim-drake estimate datasets/lab --out lab.csv --masks --images 1/0 1/3`

    `physim-drake evaluate lab.csv datasets/lab` then judges them.
    """
    from physim_drake.batch.image_names import choose_images, parse_images
    from physim_drake.cli.detections import detection_source_for
    from physim_drake.cli.estimate_run import EstimateJob, run_estimate
    from physim_drake.datasets.bop import BopDataset
    from physim_drake.datasets.results_writer import ResultsWriter
    from physim_drake.objects.model import ObjectLibrary
    from physim_drake.storage.files import make_folder

    height = surface_height(surface)
    config = _config(method, plain, expansions, hypotheses, least_confidence)
    config = replace(config, seed=seed, workers=workers or default_workers())
    data = BopDataset(dataset, split, models)
    named = parse_images(images or (), "--images")
    wanted = data.targets(targets, named)
    chosen = choose_images(wanted, images or (), "--images")
    of_chosen = [t for t in wanted if (t.scene_id, t.im_id) in set(chosen)]
    library = ObjectLibrary.load(data.models, {t.object_id for t in of_chosen})
    source = detection_source_for(method, data, detections, masks, weights, of_chosen)
    for folder in (overlays, trace):
        if folder is not None:
            make_folder(folder)
    job = EstimateJob(
        dataset=data,
        targets=wanted,
        images=chosen,
        detections=source.boxes_only() if boxes else source,
        library=library,
        config=config,
        surface_height=height,
        engine=engine,
        overlays=overlays,
        trace=trace,
    )
    settings = {
        "dataset": str(dataset.resolve()),
        "split": split,
        "models": str(data.models.resolve()),
        "detections": job.detections.name,
        "surface": "none"
        if surface == "none"
        else "auto"
        if height is None
        else f"{height:g}",
        "method": str(method),
        "expansions": str(expansions),
        "hypotheses": str(hypotheses),
        "seed": str(seed),
        "plain": str(plain),
        "least_confidence": f"{config.required_confidence:g}",
    }
    with ResultsWriter(out, resume, settings) as writer:
        failed = run_estimate(job, writer, messages(quiet))
    if failed:
        raise typer.Exit(IMAGES_FAILED)


def _config(
    method: Method,
    plain: bool,
    expansions: int,
    hypotheses: int,
    least_confidence: float | None,
) -> EstimationConfig:
    from physim_drake.estimation.config import EstimationConfig

    config = EstimationConfig.paper() if plain else EstimationConfig()
    config = config.with_budget(expansions, hypotheses)
    if least_confidence is not None:
        config = replace(config, least_confidence=least_confidence)
    return replace(config, method=method)
