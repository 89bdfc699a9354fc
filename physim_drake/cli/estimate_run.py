# SPDX-License-Identifier: MIT
"""How `physim-drake estimate` goes through the images and tells about it."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from physim_drake.batch.detection_source import DetectionSource, match_detections
from physim_drake.batch.images import ImageFailure, ImageResult, estimate_images
from physim_drake.batch.ray import make_estimator
from physim_drake.cli.interrupts import say_interrupted
from physim_drake.cli.output import counted
from physim_drake.cli.progress import Steps
from physim_drake.datasets.bop import BopDataset, ImageId, Target
from physim_drake.datasets.results_writer import ResultsWriter
from physim_drake.estimation.config import EstimationConfig
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.observation import Detection
from physim_drake.parallel.engine import Engine
from physim_drake.rendering.depth import DepthRenderer
from physim_drake.rendering.overlay import draw_overlay, write_png

_log = logging.getLogger(__name__)
_PLAIN: Any = {"markup": False, "soft_wrap": True}
"""How a line is printed that may quote files."""


@dataclass
class _Tally:
    """What the images of a run came to, without the images, to save memory."""

    images: int = 0
    failed: int = 0
    objects: int = 0
    found: int = 0
    seconds: float = 0.0

    def add(self, result: ImageResult) -> None:
        """Counts one more."""
        self.images += 1
        self.objects += len(result.estimate.objects)
        self.found += sum(o.found for o in result.estimate.objects)
        self.seconds += result.seconds


@dataclass(frozen=True)
class EstimateJob:
    """What one call of the command estimates.

    Attributes:
        dataset: the images.
        targets: objects to look for, also those of other images.
        images: scene and image ids to estimate.
        detections: source of the objects' places.
        library: the objects.
        config: settings of the estimate.
        surface_height: z of the support surface in the world, m; found if None.
        engine: machine or cluster that does the work.
        overlays: folder for pictures, if any are wanted.
        trace: folder for files about the searches, if any are wanted.
    """

    dataset: BopDataset
    targets: Sequence[Target]
    images: Sequence[ImageId]
    detections: DetectionSource
    library: ObjectLibrary
    config: EstimationConfig
    surface_height: float | None = None
    engine: Engine = Engine.LOCAL
    overlays: Path | None = None
    trace: Path | None = None

    def matched(self, image: ImageId) -> list[Detection]:
        """The detections of an image's targets."""
        found = self.detections.look_up(image)
        return match_detections(self.targets, image, found, self.dataset)


def run_estimate(job: EstimateJob, writer: ResultsWriter, console: Console) -> int:
    """Estimates the images that `writer` does not have yet, and tells how it goes.

    An image that fails is told of and left out of the results, so that a resumed run
    tries it again.

    Returns:
        the number of images that failed.

    Raises:
        InputError: if a file cannot be written; what was done before is kept.
    """
    todo = [image for image in job.images if image not in writer.done]
    tally = _Tally()
    draw = _Drawer(job.library)
    with (
        Steps(console, "image", len(job.images)) as steps,
        _said_when_interrupted(writer),
        make_estimator(job.engine, job.library, job.config) as estimator,
    ):
        steps.begin(len(job.images) - len(todo), "loading (compiles at first use)")
        for result in estimate_images(
            job.dataset, todo, job.matched, estimator, job.surface_height
        ):
            if isinstance(result, ImageFailure):
                _tell_failure(console, result)
                tally.failed += 1
                steps.advance()
                continue
            if job.overlays is not None:
                draw(result, job.overlays)
            if job.trace is not None:
                result.write_trace(job.trace)
            # Last, so that --resume makes up for pictures that were cut off.
            writer.write_image(*result.image, result.rows(), result.seconds)
            tally.add(result)
            _tell(console, result, job.targets)
            _log.info("%s: seconds by stage: %s", *_stages(result))
            steps.advance()
    console.print(_summary(tally, len(job.images), writer.path), **_PLAIN)
    return tally.failed


def _tell_failure(console: Console, failure: ImageFailure) -> None:
    """An error of one image, which is told even if nothing else is."""
    shown = Console(stderr=True, highlight=False) if console.quiet else console
    shown.print(f"{_name(failure.image)}: failed: {failure.error}", **_PLAIN)


def _tell(console: Console, result: ImageResult, targets: Sequence[Target]) -> None:
    """A table of the image on a terminal; elsewhere only what is not found."""
    if console.is_terminal:
        console.print(_table(result))
    for line in _remarks(result, targets):
        console.print(f"{_name(result.image)}{line}", **_PLAIN)


def _remarks(result: ImageResult, targets: Sequence[Target]) -> Iterator[str]:
    """What is to be said of an image: a warning, and what was not found or detected."""
    estimate = result.estimate
    if estimate.warning:
        yield f": warning: {estimate.warning}"
    for item in estimate.objects:
        if not item.found:
            yield f" {item.name}: not found: {estimate.reason_alone(item)}"
    for target in targets:
        if (target.scene_id, target.im_id) != result.image:
            continue
        given = [o for o in estimate.objects if o.object_id == target.object_id]
        if len(given) < target.count:
            yield f" {given[0].name}: {target.count} are targets, {len(given)} detected"


def _summary(tally: _Tally, total: int, path: Path) -> str:
    if not tally.images and not tally.failed:
        return f"all {total} images were done: {path}"
    failed = f", {counted(tally.failed, 'image')} failed" if tally.failed else ""
    each = f", {tally.seconds / tally.images:.1f} s an image" if tally.images else ""
    return (
        f"{counted(tally.images, 'image')}, {tally.found} of "
        f"{counted(tally.objects, 'object')} found{each}{failed}: {path}"
    )


@contextmanager
def _said_when_interrupted(writer: ResultsWriter) -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        done = len(writer.done)
        verb = "is" if done == 1 else "are"
        say_interrupted(
            f"{counted(done, 'image')} {verb} in {writer.path}; --resume goes on"
        )
        raise


class _Drawer:
    """Writes overlays; keeps the renderer while the camera stays the same."""

    def __init__(self, library: ObjectLibrary) -> None:
        self._library = library
        self._renderer: DepthRenderer | None = None

    def __call__(self, result: ImageResult, folder: Path) -> None:
        camera = result.observation.intrinsics
        if self._renderer is None or self._renderer.intrinsics != camera:
            self._renderer = DepthRenderer(self._library, camera)
        picture = draw_overlay(
            result.observation, result.estimate, self._library, self._renderer
        )
        write_png(folder / f"{result.stem}.png", picture)


def _stages(result: ImageResult) -> tuple[str, str]:
    stages = result.estimate.stages.items()
    return _name(result.image), ", ".join(f"{k} {v:.2f}" for k, v in stages)


def _table(result: ImageResult) -> Table:
    title = f"{_name(result.image)}: {result.seconds:.1f} s"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1))
    table.add_column("object", overflow="fold")
    table.add_column("found")
    table.add_column("confidence", justify="right")
    for item in result.estimate.objects:
        found = "yes" if item.found else "no"
        confidence = f"{item.confidence:.2f}" if item.found else "-"
        table.add_row(item.name, found, confidence)
    return table


def _name(image: ImageId) -> str:
    return f"{image[0]}/{image[1]}"
