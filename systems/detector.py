# SPDX-License-Identifier: MIT
"""Finds the objects in images by any algorithm: a network, an oracle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from physim_drake.camera import DepthImage
from physim_drake.observation.detection_selection import ChoiceConfig, choose_detections
from physim_drake.observation.detector import DetectionAlgorithm, LabelImage
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.scenes.views import jittered_boxes
from physim_drake.systems.object_instances import ObjectInstance
from physim_drake.systems.stage import EACH_STEP, Look, Stage, TimingConfig


@dataclass(frozen=True)
class DetectorConfig:
    """How a detector is run.

    Attributes:
        seed: seed of its random choices; those for the n-th look are always the same.
        timing: times at which inputs are read and results are shown.
    """

    seed: int = 0
    timing: TimingConfig = EACH_STEP


class Detector(Stage):
    """Runs a detection algorithm on each look.

    .. pydrake_system::

        name: Detector
        input_ports:
        - observation
        - labels (optional)
        output_ports:
        - detections

    Inputs: ``observation`` (Stamped[RgbdObservation]) and ``labels`` (Stamped of an
    int16 image (height, width)). Output: ``detections`` (Stamped[tuple[Detection,
    ...]]), boxes in pixels.

    Args:
        algorithm: finds the objects.
        config: seed and timing.
    """

    def __init__(
        self, algorithm: DetectionAlgorithm, config: DetectorConfig = DetectorConfig()
    ) -> None:
        super().__init__(
            {"observation": RgbdObservation, "labels": LabelImage},
            {"detections": tuple[Detection, ...]},
            config.timing,
            optional=("labels",),
        )
        self._algorithm, self._seed = algorithm, config.seed

    def work(self, look: Look) -> tuple[Any, ...]:
        """Detects the objects."""
        generator = np.random.default_rng([self._seed, look.number])
        observation, labels = look["observation"], look["labels"]
        return (self._algorithm.detect(observation, labels, generator),)


class FindsInColor(Protocol):
    """A network that is ready to use, as `NetworkDetector` is."""

    def detect(
        self, color: NDArray[np.uint8], depth: DepthImage | None
    ) -> tuple[Detection, ...]:
        """Finds all that it knows in a colour image (height, width, 3)."""
        ...


class TrainedDetector:
    """Detects what a network sees in the colour image. It does not need labels.

    Args:
        network: network, for instance a `NetworkDetector`.
        counts: greatest number of each object, by its id.
        config: which of the network's detections are believed.
    """

    def __init__(
        self,
        network: FindsInColor,
        counts: Mapping[int, int],
        config: ChoiceConfig = ChoiceConfig(),  # noqa: B008 (frozen)
    ) -> None:
        self._network, self._counts, self._config = network, dict(counts), config

    def detect(
        self,
        observation: RgbdObservation,
        labels: LabelImage | None,
        generator: np.random.Generator,
    ) -> tuple[Detection, ...]:
        """Gives the detections to believe, surest first."""
        color = observation.need_color()
        found = self._network.detect(color, observation.depth)
        height, width = observation.depth.shape
        return choose_detections(found, self._counts, (height, width), self._config)


class OracleDetector:
    """Boxes of the pixels that truly show an object, a little off. It needs labels.

    Args:
        instances: the objects that may be seen.
        jitter: share of the box's size that each side is off by at most.
        min_pixels: number of pixels that an object must show to be detected.
    """

    def __init__(
        self,
        instances: Sequence[ObjectInstance],
        jitter: float = 0.06,
        min_pixels: int = 100,
    ) -> None:
        self._instances, self._jitter = tuple(instances), jitter
        self._min_pixels = min_pixels

    def detect(
        self,
        observation: RgbdObservation,
        labels: LabelImage | None,
        generator: np.random.Generator,
    ) -> tuple[Detection, ...]:
        """Gives one detection for each instance that is seen, in their order."""
        if labels is None:
            raise ValueError("the oracle needs labels: connect the port of that name")
        visible = {i: labels == i.body_index for i in self._instances}
        seen = [i for i, mask in visible.items() if mask.sum() >= self._min_pixels]
        if not seen:
            return ()
        masks = np.stack([visible[i] for i in seen])
        ids = [i.object_id for i in seen]
        return tuple(jittered_boxes(masks, ids, self._jitter, generator))
