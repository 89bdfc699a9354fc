# SPDX-License-Identifier: MIT
"""How well a detector does on a dataset whose masks are known."""

from __future__ import annotations

import time
from collections.abc import Sequence

from physim_drake.datasets.bop import BopDataset, ImageId
from physim_drake.detection.average_precision import AveragePrecision, average_precision
from physim_drake.detection.detector import NetworkDetector


def evaluate_detector(
    detector: NetworkDetector, dataset: BopDataset, images: Sequence[ImageId]
) -> tuple[AveragePrecision, float]:
    """Compares a network's detections with the visible masks of images.

    Args:
        detector: network to evaluate.
        dataset: dataset that holds the images.
        images: scene and image ids.

    Returns:
        the average precision, and the mean seconds per image.

    Raises:
        InputError: if files cannot be used, or an image has no colour.
    """
    found, truth, seconds = [], [], 0.0
    for image in images:
        observation = dataset.observation(*image)
        color = observation.need_color()
        start = time.monotonic()
        found.append(detector.detect(color, observation.depth))
        seconds += time.monotonic() - start
        truth.append(dataset.masks(*image))
    return average_precision(found, truth), seconds / max(len(images), 1)
