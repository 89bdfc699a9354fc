# SPDX-License-Identifier: MIT
"""Replays recorded images as if a camera took them now."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydrake.systems.framework import Context

from physim_drake.batch.detection_source import DetectionSource, match_detections
from physim_drake.batch.image_names import choose_images
from physim_drake.datasets.bop import BopDataset
from physim_drake.errors import InputError
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.systems.source import Source
from physim_drake.systems.stage import EACH_STEP, TimingConfig


@dataclass(frozen=True)
class ReplaySourceConfig:
    """What is replayed, from the files that ``physim-drake estimate`` reads.

    Attributes:
        dataset: root of a dataset in BOP layout.
        split: folder of its images.
        images: images to show, as SCENE/IMAGE, in this order; all that have targets if
            empty.
        detections: file of the detections; if None, the dataset's
            ``detections.json``, or what the network of the package detects if the
            dataset has no such file.
        masks: whether to take the dataset's visible masks as detections instead.
        repeat: whether to begin again after the last image; else there are no more
            looks.
    """

    dataset: Path = Path()
    split: str = "test"
    images: tuple[str, ...] = ()
    detections: Path | None = None
    masks: bool = False
    repeat: bool = False

    def __post_init__(self) -> None:
        if self.masks and self.detections is not None:
            raise InputError(
                "replay", "is given together with masks", "give one", "detections"
            )


class ReplaySource(Source):
    """Shows the images of a dataset one after the other, with their detections.

    .. pydrake_system::

        name: ReplaySource
        input_ports:
        - trigger (optional with a period)
        output_ports:
        - observation
        - detections

    Input: ``trigger`` see `Source`. Outputs: ``observation`` (Stamped[RgbdObservation])
    and ``detections`` (Stamped[tuple[Detection, ...]]), of the targets that the dataset
    names in the image. A file is read when its image's turn comes.

    Args:
        config: the images and detections to show.
        period: time between two looks, s; see `Source`.
        timing: see `Source`; a simulation of a replay alone needs a `poll_period`.

    Raises:
        InputError: if the dataset or an image named does not exist.
    """

    def __init__(
        self,
        config: ReplaySourceConfig,
        period: float | None = None,
        timing: TimingConfig = EACH_STEP,
    ) -> None:
        outputs = {"observation": RgbdObservation, "detections": tuple[Detection, ...]}
        super().__init__(outputs, period, timing)
        self._dataset = BopDataset(config.dataset, config.split)
        self._targets = self._dataset.targets()
        self._images = choose_images(self._targets, config.images)
        self._detections = _detection_source(self._dataset, config)
        self._repeat = config.repeat

    def has_look(self, number: int) -> bool:
        """Whether there is another image."""
        return self._repeat or number <= len(self._images)

    def capture(self, context: Context, number: int) -> tuple[Any, ...]:
        """Reads the next image."""
        image = self._images[(number - 1) % len(self._images)]
        observation = self._dataset.observation(*image)
        seen = self._detections.look_up(image)
        matched = match_detections(self._targets, image, seen, self._dataset)
        return observation, tuple(matched)


def _detection_source(
    dataset: BopDataset, config: ReplaySourceConfig
) -> DetectionSource:
    """What the configuration says about the places of the objects."""
    if config.masks:
        return DetectionSource.masks(dataset)
    if config.detections is not None:
        return DetectionSource.file(dataset, config.detections)
    return DetectionSource.default(dataset)
