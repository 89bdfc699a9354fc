# SPDX-License-Identifier: MIT
"""`physim-drake train`: teach a detector from object models alone."""

from __future__ import annotations

from contextlib import ExitStack
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from physim_drake.cli.options import (
    ContainerOption,
    EngineOption,
    LibraryFolder,
    LogLevel,
    Quiet,
    Resume,
    SceneViews,
    Seed,
    Threads,
    Workers,
)
from physim_drake.cli.output import LogLevelName, messages
from physim_drake.cli.progress import Steps
from physim_drake.closing import Closing
from physim_drake.detection.networks.config import BackboneName, NetworkKind
from physim_drake.detection.networks.device_name import DeviceName
from physim_drake.extras import need_extra
from physim_drake.models import APC11
from physim_drake.objects.container_name import ContainerName
from physim_drake.parallel.cores import default_workers
from physim_drake.parallel.engine import Engine

if TYPE_CHECKING:
    from rich.console import Console


class Precision(StrEnum):
    """Precision of the products while the network learns."""

    AUTO = "auto"
    FLOAT32 = "float32"
    BFLOAT16 = "bfloat16"


def train(
    out: Annotated[
        Path,
        typer.Argument(help="Folder for all that the run writes.", show_default=False),
    ],
    models: LibraryFolder = APC11,
    scenes: Annotated[
        int, typer.Option(min=1, help="Number of scenes to generate and learn from.")
    ] = 500,
    views: SceneViews = 8,
    test_images: Annotated[
        int, typer.Option(min=1, help="Number of images of other scenes to test on.")
    ] = 200,
    steps: Annotated[int, typer.Option(min=1, help="Number of training steps.")] = 4500,
    batch: Annotated[
        int,
        typer.Option(min=1, help="Number of images that a training step learns from."),
    ] = 8,
    learning_rate: Annotated[
        float,
        typer.Option(
            min=1e-6,
            max=0.1,
            help="The highest learning rate; with --start a third of the default is "
            "enough.",
        ),
    ] = 1e-3,
    calm: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=1.0,
            help="The share of the steps, at the end, in which the images are changed "
            "only a little.",
        ),
    ] = 0.2,
    network: Annotated[
        NetworkKind,
        typer.Option(
            help="faster-rcnn finds objects with boxes and masks; fcn tells the class "
            "of each pixel."
        ),
    ] = NetworkKind.FASTER_RCNN,
    backbone: Annotated[
        BackboneName, typer.Option(help="The network's part that computes features.")
    ] = BackboneName.RESIDUAL,
    image_size: Annotated[
        int,
        typer.Option(
            min=64,
            max=2048,
            help="The longer side, in pixels, to which images are scaled.",
        ),
    ] = 448,
    depth: Annotated[
        bool, typer.Option("--depth", help="Learn from depth as well as colour.")
    ] = False,
    data: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="DATASET",
            help="Learn from a dataset in BOP layout with mask_visib, instead of "
            "generated scenes. It may be given several times; each dataset then "
            "counts the same.",
        ),
    ] = None,
    start: Annotated[
        Path | None,
        typer.Option(
            metavar="WEIGHTS",
            help="Start from these weights, of the same or of other objects.",
        ),
    ] = None,
    start_share: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=0.99,
            help="The share that the weights of --start have in the result; with 0.5 "
            "it does better on images unlike those that it learnt from.",
        ),
    ] = 0.0,
    container: ContainerOption = ContainerName.TABLE,
    workers: Workers = None,
    threads: Threads = None,
    device: Annotated[
        DeviceName,
        typer.Option(help="The device to train on; auto takes a GPU if there is one."),
    ] = DeviceName.AUTO,
    precision: Annotated[
        Precision,
        typer.Option(
            help="Precision of the computation; auto takes what is fast on the device."
        ),
    ] = Precision.AUTO,
    save_every: Annotated[
        int,
        typer.Option(
            min=1,
            help="Number of steps between saves; no more are lost if a run is cut off.",
        ),
    ] = 200,
    seed: Seed = 0,
    resume: Resume = False,
    engine: EngineOption = Engine.LOCAL,
    quiet: Quiet = False,
    log_level: LogLevel = LogLevelName.WARNING,
) -> None:
    """Train a detector on scenes that it generates itself.

    Scenes of the objects settle with physics and are seen under random lights, on
    random surfaces, among random things; a network learns to find the objects and
    their masks in them. OUT gets `detector.safetensors`, which `detect` and `estimate`
    take; `training.json` and `training.png`, the losses and mean average precisions;
    and the images, in BOP layout, in `data` and `test`.

    A run that was cut off goes on with `--resume` and ends with the same weights.

    Example: `physim-drake train out/detector --models datasets/lab/models`
    """
    need_extra("train")

    import torch

    from physim_drake.detection.networks.config import NetworkConfig
    from physim_drake.detection.networks.devices import choose_device
    from physim_drake.detection.training.detector_training import (
        WEIGHTS_FILE,
        DetectorTrainingJob,
        TrainDetectorConfig,
        train_detector,
    )
    from physim_drake.detection.training.scene_sets import SceneSetConfig
    from physim_drake.detection.training.trainer import TrainingConfig
    from physim_drake.objects.model import ObjectLibrary

    chosen = choose_device(device)
    if threads is not None:
        torch.set_num_threads(threads)
    config = TrainDetectorConfig(
        SceneSetConfig(scenes, views, test_images, container, seed),
        NetworkConfig(
            kind=network,
            backbone=backbone,
            channels=4 if depth else 3,
            image_size=image_size,
        ),
        TrainingConfig(
            steps=steps,
            batch=batch,
            learning_rate=learning_rate,
            calm=calm,
            warmup=min(300, max(steps // 10, 1)),
            save_every=save_every,
            test_every=max(steps // 8, 1),
            seed=seed,
            bfloat16=_bfloat16(precision, chosen),
        ),
        data=tuple(data or ()),
        start=start,
        start_share=start_share,
    )
    library = ObjectLibrary.load(models)
    with _Reporter(messages(quiet)) as tell:
        job = DetectorTrainingJob(
            out,
            library,
            config,
            workers or default_workers(),
            chosen,
            resume,
            engine,
            tell,
        )
        result = train_detector(job)
    typer.echo(f"{out / WEIGHTS_FILE}: {result}")


def _bfloat16(precision: Precision, device: Any) -> bool:
    from physim_drake.detection.networks.devices import has_fast_bfloat16

    if precision is Precision.AUTO:
        return has_fast_bfloat16(device)
    return precision is Precision.BFLOAT16


class _Reporter(Closing):
    """Tells how far each stage of a training run is."""

    def __init__(self, console: Console) -> None:
        self._console, self._stage = console, ""
        self._steps: Steps | None = None
        self._open = ExitStack()

    def close(self) -> None:
        """Takes the bar away."""
        self._open.close()

    def __call__(self, stage: str, done: int, total: int, text: str) -> None:
        if self._steps is not None and stage == "test":
            self._steps.say(f"after {done} steps: {text}")
            return
        if self._steps is None or stage != self._stage:
            self.close()
            self._stage = stage
            self._steps = Steps(self._console, stage.removesuffix("s"), total)
            self._open.enter_context(self._steps).begin(done)
        self._steps.reach(done, text)
