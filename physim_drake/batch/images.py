# SPDX-License-Identifier: MIT
"""Estimating a dataset image by image: which detections, how long, what to keep."""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from physim_drake.batch.ray import Estimator
from physim_drake.datasets.bop import BopDataset, ImageId, Target
from physim_drake.datasets.detections import load_detections, warn_of_left_out
from physim_drake.datasets.results import ResultRow
from physim_drake.errors import InputError
from physim_drake.estimation.preparation import EstimationRequest
from physim_drake.extras import need_extra
from physim_drake.models import APC11, DETECTOR
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from physim_drake.storage.files import write_atomically

DetectionLookup = Callable[[ImageId], Sequence[Detection]]
"""Gives the detections of an image, none where it has none."""


@dataclass(frozen=True)
class ImageResult:
    """What came of one image.

    Attributes:
        image: scene id and image id.
        observation: the image.
        estimate: the objects in it.
        seconds: from opening its files to the last pose.
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


def detection_lookup(
    dataset: BopDataset,
    file: Path | None = None,
    masks: bool = False,
    weights: Path | None = None,
    targets: Sequence[Target] | None = None,
) -> tuple[DetectionLookup, str]:
    """Where the detections of a dataset's images come from.

    Args:
        dataset: the images.
        file: detections in BOP's JSON format; where it is None the dataset's own
            `detections.json`, and where there is none the network that comes with the
            package.
        masks: take the dataset's visible masks instead.
        weights: or what the network with these weights detects.
        targets: what is looked for, which a network has to know; the dataset's own
            where it is None. Detections in a file of what is none of them are told.

    Returns:
        the look-up, and what to call its source.

    Raises:
        InputError: where more than one source is given, or nothing is to be had.
    """
    given = {"--detections": file, "--masks": masks or None, "--weights": weights}
    named = [name for name, value in given.items() if value is not None]
    if len(named) > 1:
        raise InputError(
            named[0], f"given together with {named[1]}", "give one of the two"
        )
    if masks:
        return lambda image: dataset.masks(*image), "masks"
    own = dataset.root / "detections.json"
    if weights is not None:
        return trained_lookup(dataset, weights, targets)
    if file is None and not own.exists():
        _check_default(own)
        try:
            return trained_lookup(dataset, None, targets)
        except InputError as error:
            raise InputError(
                own,
                f"does not exist, and the network of the package cannot stand in: "
                f"{error.source}: {error.problem}",
                "give boxes in this file or with --detections FILE, --weights of a "
                "network that was trained with these models, or --masks",
            ) from error
    path = file or own
    detections = load_detections(path, dataset)
    warn_of_left_out(detections, targets or (), path)
    return lambda image: detections.get(image, []), str(path.resolve())


def trained_lookup(
    dataset: BopDataset,
    weights: Path | None = None,
    targets: Sequence[Target] | None = None,
    *,
    pixels: bool = False,
) -> tuple[DetectionLookup, str]:
    """What a trained network detects, whatever else says where the objects are.

    Args:
        dataset: the images.
        weights: of the network; by default those that come with the package.
        targets: what it has to know; the dataset's own where it is None.
        pixels: use only what tells the class of every pixel, as the method fcn-pca-icp
            does.

    Returns:
        the look-up, and what to call its source.

    Raises:
        InputError: where the weights cannot be used, or are for other objects.
    """
    need_extra("train")
    # Imported here, since torch takes its time.
    from physim_drake.detection.network_lookup import network_lookup

    if weights is not None:
        return network_lookup(dataset, weights, targets, pixels=pixels)
    return network_lookup(dataset, DETECTOR, targets, like=APC11, pixels=pixels)


def boxes_only(look_up: DetectionLookup) -> DetectionLookup:
    """The same detections without their masks."""

    def without_masks(image: ImageId) -> list[Detection]:
        return [_without_mask(d) for d in look_up(image)]

    return without_masks


def _without_mask(detection: Detection) -> Detection:
    instead = tuple(replace(d, mask=None) for d in detection.instead)
    if detection.seen:
        return replace(detection, mask=None, instead=instead)
    return replace(detection, instead=instead)


def _check_default(own: Path) -> None:
    """Says what to give where a dataset has no detections and there are no weights."""
    if not DETECTOR.exists():
        raise InputError(
            own,
            "does not exist, so where the objects are in the images is not known",
            "give --detections FILE (boxes in BOP's JSON format), --weights FILE of a "
            "network that finds them, or --masks to use the dataset's mask_visib",
        )


def choose_images(targets: Sequence[Target], names: Iterable[str]) -> list[ImageId]:
    """The images of the targets, or those of them that are named SCENE/IMAGE.

    Raises:
        InputError: where a name is malformed or has no target.
    """
    known = list(dict.fromkeys((t.scene_id, t.im_id) for t in targets))
    chosen = []
    for name in names:
        scene, _, image = name.partition("/")
        if not (_is_id(scene) and _is_id(image)):
            raise InputError(
                "--images", f"{name!r} is no image", "give SCENE/IMAGE, as in 1/0"
            )
        if (int(scene), int(image)) not in known:
            some = ", ".join(f"{s}/{i}" for s, i in known[:5])
            more = ", ..." if len(known) > 5 else ""
            raise InputError(
                "--images", f"{name} has no target", f"there are {some}{more}"
            )
        chosen.append((int(scene), int(image)))
    return list(dict.fromkeys(chosen)) or known


def match_detections(
    targets: Iterable[Target], image: ImageId, found: Sequence[Detection], source: str
) -> list[Detection]:
    """The best-scored detections of each of an image's targets.

    Detections of other objects are left out. Where a source says that it did not see
    an object (`Detection.unseen`), it says so once for each instance that is missing.

    Args:
        targets: of any images.
        image: which image.
        found: its detections.
        source: what to call their source.

    Raises:
        InputError: where a target has no detection at all.
    """
    matched: list[Detection] = []
    for target in targets:
        if (target.scene_id, target.im_id) != image:
            continue
        same = [d for d in found if d.object_id == target.object_id]
        if not same:
            raise InputError(
                source,
                f"has no detection of object {target.object_id} in image "
                f"{image[0]}/{image[1]}, which is a target",
                "add one, or remove the target",
            )
        seen = sorted((d for d in same if d.seen), key=lambda d: -d.score)
        unseen = [d for d in same if not d.seen]
        missing = target.count - len(seen)
        matched += [*seen, *(unseen + unseen[-1:] * missing)][: target.count]
    return matched


def estimate_images(
    dataset: BopDataset,
    images: Iterable[ImageId],
    detections: Callable[[ImageId], Sequence[Detection]],
    estimator: Estimator,
    surface_height: float | None = None,
) -> Iterator[ImageResult]:
    """Estimates images; the results come in the order of the images.

    Args:
        dataset: where the images are.
        images: which ones.
        detections: gives the objects to find in an image (see `match_detections`).
        estimator: does it.
        surface_height: z of the support surface in the world, m; found if None.

    Raises:
        InputError: where an image cannot be used; those before it have been given.
    """
    read: deque[tuple[ImageId, RgbdObservation, float]] = deque()

    def requests() -> Iterator[EstimationRequest]:
        """Reads the images, as the estimator asks for them."""
        for image in images:
            start = time.monotonic()
            observation = dataset.observation(*image)
            chosen = detections(image)
            read.append((image, observation, time.monotonic() - start))
            yield EstimationRequest(observation, chosen, surface_height)

    estimates = estimator.estimate_all(requests())
    while True:
        try:
            estimate = next(estimates, None)
        except InputError as error:
            name = read[0][1].name if read else error.source
            if error.source == name:
                raise
            raise InputError(
                name, f"{error.source}: {error.problem}", error.remedy
            ) from error
        if estimate is None:
            return
        image, observation, seconds = read.popleft()
        yield ImageResult(image, observation, estimate, seconds + estimate.seconds)


def _is_id(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) < 10


def _object_as_dict(estimate: ObjectEstimate) -> dict[str, Any]:
    return {
        "object_id": estimate.object_id,
        "name": estimate.name,
        "confidence": estimate.confidence,
        "reason": estimate.reason,
        "X_CO": None if estimate.X_CO is None else estimate.X_CO.tolist(),
    }
