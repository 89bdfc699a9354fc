# SPDX-License-Identifier: MIT
"""Estimates a dataset image by image, and keeps what came of each."""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physim_drake.batch.ray import Estimator, attempt_all
from physim_drake.datasets.bop import BopDataset, ImageId
from physim_drake.datasets.results import ResultRow
from physim_drake.errors import InputError
from physim_drake.estimation.preparation import EstimationRequest
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from physim_drake.storage.files import write_atomically


@dataclass(frozen=True)
class ImageResult:
    """What came of one image.

    Attributes:
        image: scene id and image id.
        observation: the image.
        estimate: the objects in it.
        seconds: time from opening its files to the last pose, s.
    """

    image: ImageId
    observation: RgbdObservation
    estimate: SceneEstimate
    seconds: float

    @property
    def stem(self) -> str:
        """Name of files about this image, without suffix."""
        return f"{self.image[0]:06d}_{self.image[1]:06d}"

    def rows(self) -> list[ResultRow]:
        """The objects that were found, as rows of a results file."""
        return [
            ResultRow(*self.image, o.object_id, o.confidence, o.X_CO, self.seconds)
            for o in self.estimate.objects
            if o.X_CO is not None
        ]

    def trace_as_dict(self) -> dict[str, Any]:
        """How the estimate came about, as plain lists and numbers."""
        return {
            "scene_id": self.image[0],
            "im_id": self.image[1],
            "method": self.estimate.method,
            "seconds": self.seconds,
            "stages": dict(self.estimate.stages),
            "groups": [trace.as_dict() for trace in self.estimate.trace],
            "objects": [_object_as_dict(o) for o in self.estimate.objects],
        }

    def write_trace(self, folder: Path) -> Path:
        """Writes `trace_as_dict` as JSON into a folder; returns the file."""
        path = folder / f"{self.stem}.json"
        with write_atomically(path) as file:
            json.dump(self.trace_as_dict(), file, indent=1, allow_nan=False)
            file.write("\n")
        return path


@dataclass(frozen=True)
class ImageFailure:
    """An image that could not be estimated.

    Attributes:
        image: scene id and image id.
        error: what is wrong with it.
    """

    image: ImageId
    error: InputError


def estimate_images(
    dataset: BopDataset,
    images: Iterable[ImageId],
    detections: Callable[[ImageId], Sequence[Detection]],
    estimator: Estimator,
    surface_height: float | None = None,
) -> Iterator[ImageResult | ImageFailure]:
    """Estimates images; the results come in the order of the images.

    An image that cannot be used does not keep the others from their results.

    Args:
        dataset: the dataset of the images.
        images: scene and image ids, in the order of the results.
        detections: function that gives the objects to find in an image; see
            `match_detections`.
        estimator: the estimator of one image after another.
        surface_height: z of the support surface in the world, m; found if None.
    """
    read: deque[tuple[ImageId, RgbdObservation, float] | ImageFailure] = deque()

    def requests() -> Iterator[EstimationRequest]:
        """Reads the images, as the estimator asks for them."""
        for image in images:
            start = time.monotonic()
            try:
                observation = dataset.observation(*image)
                chosen = detections(image)
            except InputError as error:
                read.append(ImageFailure(image, error))
                continue
            read.append((image, observation, time.monotonic() - start))
            yield EstimationRequest(observation, chosen, surface_height)

    for answer in attempt_all(estimator, requests()):
        while isinstance(first := read.popleft(), ImageFailure):
            yield first
        image, observation, seconds = first
        if isinstance(answer, InputError):
            yield ImageFailure(image, answer.about(observation.name))
        else:
            yield ImageResult(image, observation, answer, seconds + answer.seconds)
    # No estimate comes after these, for only images that were read have one.
    yield from (item for item in read if isinstance(item, ImageFailure))


def _object_as_dict(estimate: ObjectEstimate) -> dict[str, Any]:
    return {
        "object_id": estimate.object_id,
        "name": estimate.name,
        "confidence": estimate.confidence,
        "reason": estimate.reason,
        "X_CO": None if estimate.X_CO is None else estimate.X_CO.tolist(),
    }
