# SPDX-License-Identifier: MIT
"""How `physim-drake estimate` goes through the images and tells about it."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from physim_drake.batch.detection_source import DetectionLookup, match_detections
from physim_drake.batch.images import ImageResult, estimate_images
from physim_drake.batch.ray import make_estimator
from physim_drake.cli.interrupts import say_interrupted
from physim_drake.cli.progress import Steps
from physim_drake.datasets.bop import BopDataset, ImageId, Target
from physim_drake.datasets.results_writer import ResultsWriter
from physim_drake.estimation.estimator import EstimationConfig
from physim_drake.objects.model import ObjectLibrary
from physim_drake.parallel.engine import Engine
from physim_drake.rendering.depth import DepthRenderer
from physim_drake.rendering.overlay import draw_overlay, write_png

_log = logging.getLogger(__name__)


@dataclass
class _Tally:
    """What the images of a run came to; not the images, which would fill the memory."""

    images: int = 0
    objects: int = 0
    found: int = 0
    seconds: float = 0.0

    def add(self, result: ImageResult) -> None:
        """Counts one more."""
        self.images += 1
        self.objects += len(result.estimate.objects)
        self.found += sum(o.found for o in result.estimate.objects)
        self.seconds += result.seconds


class EstimateRun:
    """One call of the command: estimates, writes and tells how it goes."""

    def __init__(
        self,
        data: BopDataset,
        targets: Sequence[Target],
        lookup: DetectionLookup,
        source: str,
        library: ObjectLibrary,
        config: EstimationConfig,
        console: Console,
        engine: Engine = Engine.LOCAL,
    ) -> None:
        self._data, self._targets = data, targets
        self._lookup, self._source = lookup, source
        self._library, self._config, self._console = library, config, console
        self._engine = engine

    def run(
        self,
        images: Sequence[ImageId],
        writer: ResultsWriter,
        surface_height: float | None,
        overlays: Path | None,
        trace: Path | None,
    ) -> None:
        """Estimates those images that `writer` has not got yet."""
        todo = [image for image in images if image not in writer.done]
        tally = _Tally()
        draw = _Drawer(self._library)
        with (
            Steps(self._console, "image", len(images)) as steps,
            self._said_when_interrupted(writer),
            make_estimator(self._engine, self._library, self._config) as estimator,
        ):
            steps.begin(len(images) - len(todo), "loading (compiles at first use)")
            for result in estimate_images(
                self._data,
                todo,
                lambda image: match_detections(
                    self._targets, image, self._lookup(image), self._source
                ),
                estimator,
                surface_height,
            ):
                if overlays is not None:
                    draw(result, overlays)
                if trace is not None:
                    result.write_trace(trace)
                # Last, so that --resume makes up for pictures that were cut off.
                writer.write_image(*result.image, result.rows(), result.seconds)
                tally.add(result)
                self._tell(result)
                _log.info("%s: seconds by stage: %s", *_stages(result))
                steps.advance()
        self._summarise(tally, len(images), writer.path)

    def _tell(self, result: ImageResult) -> None:
        """A table of the image on a terminal; elsewhere only what is not found."""
        if self._console.is_terminal:
            self._console.print(_table(result))
        estimate = result.estimate
        if estimate.warning:
            self._console.print(
                f"{_name(result.image)}: warning: {estimate.warning}",
                markup=False,
                soft_wrap=True,
            )
        for item in estimate.objects:
            if not item.found:
                self._console.print(
                    f"{_name(result.image)} {item.name}: not found: "
                    f"{estimate.reason_alone(item)}",
                    markup=False,
                    soft_wrap=True,
                )
        for target in self._targets:
            given = [
                o for o in result.estimate.objects if o.object_id == target.object_id
            ]
            of_image = (target.scene_id, target.im_id) == result.image
            if of_image and len(given) < target.count:
                self._console.print(
                    f"{_name(result.image)} {given[0].name}: {target.count} are "
                    f"targets, {len(given)} detected",
                    markup=False,
                    soft_wrap=True,
                )

    def _summarise(self, tally: _Tally, total: int, path: Path) -> None:
        if not tally.images:
            self._console.print(f"all {total} images were done: {path}", markup=False)
            return
        self._console.print(
            f"{tally.images} images, {tally.found} of {tally.objects} objects found, "
            f"{tally.seconds / tally.images:.1f} s an image: {path}",
            markup=False,
            soft_wrap=True,
        )

    @contextmanager
    def _said_when_interrupted(self, writer: ResultsWriter) -> Iterator[None]:
        try:
            yield
        except KeyboardInterrupt:
            say_interrupted(
                f"{len(writer.done)} images are in {writer.path}; --resume goes on"
            )
            raise


class _Drawer:
    """Writes overlays; keeps one renderer a camera at hand."""

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
