# SPDX-License-Identifier: MIT
"""Detects the objects in a dataset's images and writes what was found."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from pycocotools import mask as coco_mask

from physim_drake.datasets.bop import BopDataset, ImageId, Target
from physim_drake.detection.detector import NetworkDetector
from physim_drake.errors import InputError
from physim_drake.objects.library_files import LIBRARY_FILE, find_objects
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.storage.files import write_atomically


@dataclass(frozen=True)
class DetectedImage:
    """What was found in an image.

    Attributes:
        image: scene id and image id.
        observation: the image.
        detections: detections with masks, best first.
        seconds: time that the network took.
    """

    image: ImageId
    observation: RgbdObservation
    detections: tuple[Detection, ...]
    seconds: float

    def entries(self) -> list[dict[str, Any]]:
        """The detections in BOP's JSON format."""
        return [_entry(self.image, d, self.seconds) for d in self.detections]


def detect_images(
    detector: NetworkDetector,
    dataset: BopDataset,
    images: Iterable[ImageId],
    least_score: float,
) -> Iterator[DetectedImage]:
    """Detects the objects in one image after the other.

    Args:
        detector: network that finds the objects.
        dataset: dataset that holds the images.
        images: scene and image ids.
        least_score: score below which detections are dropped.

    Raises:
        InputError: if an image cannot be used or has no colour.
    """
    for image in images:
        observation = dataset.observation(*image)
        color = observation.need_color()
        start = time.monotonic()
        found = detector.detect(color, observation.depth, least_score)
        yield DetectedImage(image, observation, found, time.monotonic() - start)


def write_detections(path: Path, entries: Sequence[dict[str, Any]]) -> None:
    """Writes detections as a list in BOP's JSON format, one a line.

    Raises:
        InputError: if the file cannot be written.
    """
    with write_atomically(path) as file:
        lines = ",\n".join(json.dumps(e, allow_nan=False) for e in entries)
        file.write(f"[\n{lines}\n]\n")


def known_targets(dataset: BopDataset) -> Sequence[Target]:
    """What a dataset's images are said to show. Empty if it does not say."""
    try:
        return dataset.targets()
    except InputError:
        return ()


def target_names(
    dataset: BopDataset, targets: Sequence[Target] | None = None
) -> dict[int, str]:
    """Names of the objects that a dataset's images are said to show, by id.

    A name is empty if the dataset does not give one. The mapping is empty if the
    dataset does not say what its images show.

    Args:
        dataset: images and models.
        targets: objects that the images are said to show. None takes the dataset's
            own.
    """
    wanted = known_targets(dataset) if targets is None else targets
    ids = sorted({target.object_id for target in wanted})
    names = dict.fromkeys(ids, "")
    if (dataset.models / LIBRARY_FILE).exists():
        known = {entry.object_id: entry.name for entry in find_objects(dataset.models)}
        names = {i: known.get(i, "") for i in ids}
    return names


def _entry(image: ImageId, detection: Detection, seconds: float) -> dict[str, Any]:
    left, top, right, bottom = (float(x) for x in detection.box)
    entry: dict[str, Any] = {
        "scene_id": image[0],
        "image_id": image[1],
        "category_id": detection.object_id,
        "bbox": [round(x, 2) for x in (left, top, right - left, bottom - top)],
        "score": round(detection.score, 4),
        "time": round(seconds, 4),
    }
    if detection.mask is not None:
        packed = coco_mask.encode(np.asfortranarray(detection.mask, dtype=np.uint8))
        entry["segmentation"] = {
            "size": list(detection.mask.shape),
            "counts": cast(bytes, packed["counts"]).decode("ascii"),
        }
    return entry
