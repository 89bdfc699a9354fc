# SPDX-License-Identifier: MIT
"""Where the detections of a dataset's images come from: a file, masks or a network."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from physim_drake.datasets.bop import BopDataset, ImageId, Target
from physim_drake.datasets.detections import load_detections, warn_of_left_out
from physim_drake.errors import InputError
from physim_drake.extras import need_extra
from physim_drake.models import APC11, DETECTOR
from physim_drake.observation.detection_selection import one_for_each_thing
from physim_drake.observation.observation import Detection

DetectionLookup = Callable[[ImageId], Sequence[Detection]]
"""Gives the detections of an image; they are empty if it has none."""

_REMEDY = (
    "give detections in this file or in another one, the weights of a network that was "
    "trained with these models, or take the dataset's masks"
)


@dataclass(frozen=True)
class DetectionSource:
    """Detections of a dataset's images, and what to call their source.

    Attributes:
        name: the file or network that they are from, as errors and settings name it.
        look_up: function that gives the detections of an image.
    """

    name: str
    look_up: DetectionLookup

    @classmethod
    def file(
        cls, dataset: BopDataset, path: Path, targets: Sequence[Target] | None = None
    ) -> Self:
        """Detections in BOP's JSON format.

        Args:
            dataset: the images.
            path: the file.
            targets: objects to look for; a warning names detections of other objects.

        Raises:
            InputError: if the file cannot be used.
        """
        images = {(t.scene_id, t.im_id) for t in targets or ()} or None
        detections = load_detections(path, dataset, images)
        warn_of_left_out(detections, targets or (), path)
        return cls(str(path.resolve()), lambda image: detections.get(image, []))

    @classmethod
    def masks(cls, dataset: BopDataset) -> Self:
        """The dataset's visible masks."""
        return cls("masks", lambda image: dataset.masks(*image))

    @classmethod
    def network(
        cls,
        dataset: BopDataset,
        weights: Path | None = None,
        targets: Sequence[Target] | None = None,
        *,
        pixels: bool = False,
    ) -> Self:
        """What a trained network detects.

        Args:
            dataset: the images.
            weights: file of the network; by default the one that comes with the
                package.
            targets: objects that it must know; by default the dataset's own.
            pixels: use only the class of every pixel, as the method fcn-pca-icp does.

        Raises:
            InputError: if the weights cannot be used, or are for other objects.
        """
        need_extra("train")
        # Imported here, since torch takes its time.
        from physim_drake.detection.network_lookup import network_lookup

        own, like = (DETECTOR, APC11) if weights is None else (weights, None)
        look_up, name = network_lookup(dataset, own, targets, like=like, pixels=pixels)
        return cls(name, look_up)

    @classmethod
    def default(
        cls,
        dataset: BopDataset,
        targets: Sequence[Target] | None = None,
        *,
        remedy: str = _REMEDY,
    ) -> Self:
        """The dataset's `detections.json`, or the network of the package without it.

        Args:
            dataset: the images.
            targets: objects to look for; by default the dataset's own.
            remedy: advice in the error if there is neither.

        Raises:
            InputError: if the file cannot be used, or if there is none and the network
                does not know the objects.
        """
        own = dataset.root / "detections.json"
        if own.exists():
            return cls.file(dataset, own, targets)
        if not DETECTOR.exists():
            problem = "does not exist, so where the objects are is not known"
            raise InputError(own, problem, remedy)
        try:
            return cls.network(dataset, None, targets)
        except InputError as error:
            raise InputError(
                own,
                "does not exist, and the network of the package cannot stand in: "
                f"{error.source}: {error.problem}",
                remedy,
            ) from error

    def boxes_only(self) -> DetectionSource:
        """The same detections without their masks."""
        return DetectionSource(
            f"boxes of {self.name}",
            lambda image: [_without_mask(d) for d in self.look_up(image)],
        )


def match_detections(
    targets: Iterable[Target],
    image: ImageId,
    found: Sequence[Detection],
    dataset: BopDataset,
) -> list[Detection]:
    """The best-scored detections of each of an image's targets.

    Detections of other objects are left out, and so are those of a thing that a surer
    detection of the same object shows. If an object has no detection, or its source
    says that it did not see it (`Detection.unseen`), the result says so once for each
    missing instance.

    Args:
        targets: objects to look for, of any images.
        image: scene id and image id.
        found: detections of the image.
        dataset: the dataset of the image.

    Raises:
        InputError: if the image's size is needed and cannot be read.
    """
    matched: list[Detection] = []
    for target in targets:
        if (target.scene_id, target.im_id) != image:
            continue
        same = [d for d in found if d.object_id == target.object_id]
        if not same:
            camera = dataset.intrinsics(*image)
            same = [Detection.unseen(target.object_id, camera.height, camera.width)]
        seen = one_for_each_thing(d for d in same if d.seen)
        unseen = [d for d in same if not d.seen]
        missing = target.count - len(seen)
        matched += [*seen, *(unseen + unseen[-1:] * missing)][: target.count]
    return matched


def _without_mask(detection: Detection) -> Detection:
    instead = tuple(replace(d, mask=None) for d in detection.instead)
    if detection.seen:
        return replace(detection, mask=None, instead=instead)
    return replace(detection, instead=instead)
