# SPDX-License-Identifier: MIT
"""Results of a study by image, kept so that an interrupted study can be resumed."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from physim_drake.datasets.bop import ImageId
from physim_drake.poses import Array
from physim_drake.scene_estimate import SceneEstimate
from physim_drake.storage.dataclass_json import from_plain, to_plain
from physim_drake.storage.json_nodes import JsonNode
from physim_drake.storage.progress_file import ProgressFile

T = TypeVar("T")


@dataclass(frozen=True)
class ImageOutcome:
    """A method's result for an image.

    Attributes:
        estimate: estimate of the image, without its detections.
        boxes: boxes of the detections, in the estimate's order, (4,) each, as in
            `Detection`.
        seconds: time that it took, reading included.
    """

    estimate: SceneEstimate
    boxes: tuple[Array, ...]
    seconds: float


@dataclass(frozen=True)
class ObjectHypothesisErrors:
    """Errors of the hypotheses of an object in an image.

    Attributes:
        selected: rotation error (degrees) and distance (cm) of the pose that each
            metric of Table II selects.
        success: True if a representative is within 6 degrees and 1.5 cm.
        poses: number of scored poses.
    """

    selected: Mapping[str, tuple[float, float]]
    success: bool
    poses: int


@dataclass(frozen=True)
class ImageHypothesisErrors:
    """Errors of the hypotheses in an image.

    Attributes:
        objects: errors for each object with hypotheses.
    """

    objects: tuple[ObjectHypothesisErrors, ...]


class StudyNotes:
    """Notes by part of the study (a method, say) and image.

    Every value is returned as if it had been read from a file, so that the results of
    a study do not depend on whether it was interrupted.

    Args:
        progress: file of the notes; None keeps them for this study only.
        earlier: notes that an earlier run left there.

    Raises:
        InputError: if one of them is not a note of a study.
    """

    def __init__(
        self, progress: ProgressFile | None = None, earlier: Iterable[JsonNode] = ()
    ) -> None:
        self._progress = progress
        self._found: dict[tuple[str, ImageId], JsonNode] = {}
        for note in earlier:
            part = note["part"].value
            image = (note["scene_id"].integer(), note["im_id"].integer())
            if not isinstance(part, str):
                note["part"].fail("is not a text")
            self._found[part, image] = note["found"]

    def __len__(self) -> int:
        return len(self._found)

    def has(self, part: str, image: ImageId) -> bool:
        """Whether there is a note that has not been taken yet."""
        return (part, image) in self._found

    def take(self, part: str, image: ImageId, kind: type[T]) -> T:
        """The value of a note, which can be taken once.

        Args:
            part: part of the study.
            image: scene id and image id.
            kind: dataclass of the value.

        Raises:
            InputError: if the note holds something else.
        """
        return from_plain(self._found.pop((part, image)), kind)

    def add(self, part: str, image: ImageId, value: object) -> None:
        """Notes a value of a dataclass.

        Raises:
            InputError: if the file cannot be written, or no longer exists.
        """
        note = {
            "part": part,
            "scene_id": image[0],
            "im_id": image[1],
            "found": to_plain(value),
        }
        source = Path("notes")
        if self._progress is not None:
            self._progress.check_in_place()
            self._progress.add(note)
            source = self._progress.path
        found = json.loads(json.dumps(note["found"]))
        self._found[part, image] = JsonNode(found, source, "found")
