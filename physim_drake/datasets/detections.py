# SPDX-License-Identifier: MIT
"""Reads detections in the JSON format of the BOP challenge."""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from physim_drake.datasets.bop import BopDataset, ImageId, Target
from physim_drake.datasets.rle import Runs, decode_runs, read_runs
from physim_drake.errors import InputError
from physim_drake.observation.observation import Detection
from physim_drake.poses import Array
from physim_drake.storage.json_nodes import JsonNode, read_json

_MAX_COORDINATE = 1e6
_MOST_NAMED = 10

_log = logging.getLogger(__name__)


class Detections(Mapping[ImageId, list[Detection]]):
    """Detections by image, in the order of their file.

    All are checked when they are loaded. Masks stay run-length encoded and are decoded
    by each look-up, because those of a whole dataset would not fit in memory. An image
    that cannot be read is an error only when it is looked up, so that the others can
    be used.
    """

    def __init__(self, entries: dict[ImageId, list[_Entry] | InputError]) -> None:
        self._entries = entries

    def __getitem__(self, image: ImageId) -> list[Detection]:
        """The detections of an image; raises `KeyError` if it has none."""
        entries = self._entries[image]
        if isinstance(entries, InputError):
            raise entries
        return [entry.detection() for entry in entries]

    def object_ids(self, image: ImageId) -> list[int]:
        """Ids of the objects that are detected in an image; masks are not decoded."""
        entries = self._entries.get(image, [])
        return [] if isinstance(entries, InputError) else [e.object_id for e in entries]

    def __iter__(self) -> Iterator[ImageId]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)


def load_detections(
    path: str | Path, dataset: BopDataset, images: Collection[ImageId] | None = None
) -> Detections:
    """Reads the detections of the images that `dataset` has.

    The file is a list of ``{"scene_id", "image_id", "category_id", "bbox": [x, y, w,
    h], "score"}``, optionally with a ``segmentation`` in COCO's run-length encoding.
    Without a score it is 1, and an empty segmentation ``[]`` is none.
    Entries of other images are skipped: BOP's files often cover more than one split.

    Args:
        path: the file.
        dataset: the images.
        images: images whose entries are kept; those of all images if None. Files of
            other images are not read.

    Raises:
        InputError: if the file or an entry cannot be used, or no entry belongs to
            an image of the dataset. A look-up raises it if its image cannot be read.
    """
    path = Path(path)
    entries: dict[ImageId, list[_Entry] | InputError] = {}
    sizes: dict[ImageId, tuple[int, int]] = {}
    others: set[ImageId] = set()
    for node in read_json(path).elements():
        image = (node["scene_id"].integer(), node["image_id"].integer())
        if images is not None and image not in images:
            others.add(image)
            continue
        if image not in entries:
            try:
                if not dataset.has_image(*image):
                    continue
                camera = dataset.intrinsics(*image)
            except InputError as error:
                entries[image] = error
                continue
            entries[image] = []
            sizes[image] = (camera.width, camera.height)
        of_image = entries[image]
        if not isinstance(of_image, InputError):
            of_image.append(_read_entry(node, *sizes[image]))
    if not entries and not any(dataset.has_image(*image) for image in others):
        raise InputError(
            path,
            f"holds no detection of an image in {dataset.root}",
            "check that the detections belong to this dataset and split",
        )
    return Detections(entries)


def warn_of_left_out(
    detections: Detections, targets: Iterable[Target], source: Path | str
) -> None:
    """Logs how many detections are of objects that are not targets of their image.

    Args:
        detections: detections in any images; images without a target do not count.
        targets: all targets.
        source: name of the detections' source.
    """
    wanted: dict[ImageId, set[int]] = defaultdict(set)
    for target in targets:
        wanted[target.scene_id, target.im_id].add(target.object_id)
    left_out = [
        object_id
        for image, ids in wanted.items()
        for object_id in detections.object_ids(image)
        if object_id not in ids
    ]
    if left_out:
        ids = sorted(set(left_out))
        named = ", ".join(map(str, ids[:_MOST_NAMED]))
        _log.warning(
            "%s: detections left out, since their objects are not targets of the "
            "image: %d (obj_id %s)",
            source,
            len(left_out),
            named + (", ..." if len(ids) > _MOST_NAMED else ""),
        )


@dataclass(frozen=True)
class _Entry:
    """A detection with its mask still encoded."""

    object_id: int
    box: Array
    score: float
    size: tuple[int, int]
    runs: Runs | None

    def detection(self) -> Detection:
        mask = None if self.runs is None else decode_runs(self.runs, *self.size)
        return Detection(self.object_id, self.box, self.score, mask)


def _read_entry(node: JsonNode, width: int, height: int) -> _Entry:
    bbox = node["bbox"]
    x, y, w, h = bbox.array(4)
    if w < 0 or h < 0:
        bbox.fail(f"has width {w:g} and height {h:g}", "neither may be negative")
    if np.abs([x, y, w, h]).max() > _MAX_COORDINATE:
        bbox.fail(f"is {bbox.value}", "give [x, y, width, height] in pixels")
    segmentation = node.get("segmentation")
    if segmentation is not None and segmentation.value == []:
        segmentation = None  # COCO's form of a detection without a mask
    return _Entry(
        node["category_id"].integer(),
        np.array([x, y, x + w, y + h]),
        1.0 if (score := node.get("score")) is None else score.number(),
        (width, height),
        None if segmentation is None else read_runs(segmentation, width, height),
    )
