# SPDX-License-Identifier: MIT
"""A network in place of a file of detections."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from physim_drake.datasets.bop import BopDataset, ImageId
from physim_drake.detection.detect_images import target_names
from physim_drake.detection.detector import NetworkDetector
from physim_drake.errors import InputError
from physim_drake.observation import Detection


def network_lookup(
    dataset: BopDataset, weights: Path, threads: int | None = None
) -> tuple[Callable[[ImageId], list[Detection]], str]:
    """Detections that a network makes when they are looked up.

    Each object that the network knows and does not see gets a detection without a
    pixel, so that it is reported as not found.

    Args:
        dataset: the images.
        weights: of the network.
        threads: CPU threads it may use.

    Returns:
        the look-up, and what to call its source.

    Raises:
        InputError: where the weights cannot be used, or are for other objects than
            the dataset's; with a look-up, where an image has no colour.
    """
    detector = NetworkDetector.load(weights, threads)
    detector.check_objects(target_names(dataset), dataset.root)

    def look_up(image: ImageId) -> list[Detection]:
        observation = dataset.observation(*image)
        if observation.color is None:
            raise InputError(
                observation.name,
                "has no colour, by which objects are detected",
                "give colour images, or detections",
            )
        found = detector.detect(observation.color, observation.depth)
        seen = {d.object_id for d in found}
        height, width = observation.depth.shape
        # The support surface is looked for around boxes: where something is seen.
        box = found[0].box if found else np.array([0.0, 0.0, width, height])
        nothing = np.zeros((height, width), dtype=bool)
        unseen = [c.object_id for c in detector.classes if c.object_id not in seen]
        return [*found, *(Detection(i, box, 0.0, nothing) for i in unseen)]

    return look_up, str(weights.resolve())
