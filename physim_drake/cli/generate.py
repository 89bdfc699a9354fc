# SPDX-License-Identifier: MIT
"""`physim-drake generate`: make scenes with ground truth."""

from __future__ import annotations

import re
from typing import Annotated

import typer

from physim_drake.cli.options import (
    ContainerOption,
    EngineOption,
    LibraryFolder,
    LogLevel,
    NewDataset,
    Quiet,
    SceneViews,
    Seed,
)
from physim_drake.cli.output import LogLevelName, counted, messages
from physim_drake.errors import InputError
from physim_drake.models import APC11
from physim_drake.objects.container_name import ContainerName
from physim_drake.parallel.engine import Engine
from physim_drake.sensors.camera_name import CameraName


def generate(
    out: NewDataset,
    scenes: Annotated[int, typer.Option(min=1, help="Number of scenes.")] = 10,
    seed: Seed = 0,
    levels: Annotated[
        str,
        typer.Option(
            metavar="LIST",
            help="Interaction levels of the scenes, in turn. 1: the objects do not "
            "touch; 2: two of them touch; 3: three do; a larger number: a pile of so "
            "many.",
        ),
    ] = "1,2,3",
    objects: Annotated[
        str,
        typer.Option(
            metavar="MIN:MAX",
            help="Fewest and most objects of a scene. A scene shows an object twice "
            "only if it has all of them.",
        ),
    ] = "2:4",
    models: LibraryFolder = APC11,
    views: SceneViews = 1,
    workers: Annotated[
        int,
        typer.Option(min=1, help="Number of processes; the files do not depend on it."),
    ] = 1,
    camera: Annotated[
        CameraName,
        typer.Option(help="The camera whose intrinsics and errors are simulated."),
    ] = CameraName.D415,
    noise: Annotated[
        bool, typer.Option(help="Whether the camera makes errors, as a real one does.")
    ] = True,
    container: ContainerOption = ContainerName.TABLE,
    min_visible: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=1.0,
            help="The least share of each object that every image must show.",
        ),
    ] = 0.25,
    resume: Annotated[
        bool,
        typer.Option(
            help="Go on with an earlier run: keep the scenes that it finished."
        ),
    ] = False,
    engine: EngineOption = Engine.LOCAL,
    quiet: Quiet = False,
    log_level: LogLevel = LogLevelName.WARNING,
) -> None:
    """Generate cluttered scenes with exact ground truth, as a BOP dataset.

    Objects are placed, settled with hydroelastic contact, labelled by which touch
    which, and seen by a camera that errs like a RealSense. Beside BOP's files there are
    `levels.json`, `detections.json` (true boxes, each side off by up to 6 %), COCO
    annotations (`scene_gt_coco.json`) and Drake model directives (`scene.dmd.yaml`).
    The same seed gives the same files.

    Example: `physim-drake generate out/scenes --scenes 30 --views 2 --workers 4`
    """
    level_numbers = _levels(levels)
    fewest, most = _range(objects)

    from physim_drake.cli.progress import Steps
    from physim_drake.objects.model import ObjectLibrary
    from physim_drake.scenes.dataset import generate_dataset
    from physim_drake.scenes.recording import DatasetConfig
    from physim_drake.scenes.views import ViewConfig

    config = DatasetConfig(
        seed=seed,
        levels=level_numbers,
        min_objects=fewest,
        max_objects=most,
        container=container,
        views=views,
        view=ViewConfig(camera=camera, noise=noise, min_visible=min_visible),
    )
    library = ObjectLibrary.load(models)
    with Steps(messages(quiet), "scene", scenes) as steps:

        def tell(done: int) -> None:
            # First, how many an earlier run has made.
            (steps.reach if steps.begun else steps.begin)(done)

        generate_dataset(out, library, config, scenes, workers, resume, tell, engine)
    images = counted(scenes * views, "image")
    typer.echo(f"{images} of {counted(scenes, 'scene')} in {out}")


def _levels(text: str) -> tuple[int, ...]:
    if not re.fullmatch(r"[1-9]\d?(,[1-9]\d?)*", text, re.ASCII):
        raise InputError(
            "--levels", f"is {text!r}", "give some of 1,2,3, or more for a pile"
        )
    return tuple(int(level) for level in text.split(","))


def _range(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d{1,4}):(\d{1,4})", text, re.ASCII)
    if not match:
        raise InputError("--objects", f"is {text!r}", "give MIN:MAX, as in 2:4")
    return int(match[1]), int(match[2])
