# SPDX-License-Identifier: MIT
"""What a study finds in each image, kept so that a study that was cut off can go on."""

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
    """What a method made of an image.

    Attributes:
        estimate: of it, without its detections.
        boxes: of the detections, in the estimate's order, (4,) each; see `Detection`.
        seconds: that it took, reading included.
    """

    estimate: SceneEstimate
    boxes: tuple[Array, ...]
    seconds: float


@dataclass(frozen=True)
class ObjectHypothesisErrors:
    """How good the hypotheses of an object in an image are.

    Attributes:
        selected: rotation error (degrees) and distance (cm) of the pose that each
            metric of Table II selects.
        success: whether a representative is within 6 degrees and 1.5 cm.
        poses: how many were scored.
    """

    selected: Mapping[str, tuple[float, float]]
    success: bool
    poses: int


@dataclass(frozen=True)
class ImageHypothesisErrors:
    """How good the hypotheses in an image are.

    Attributes:
        objects: those that have any.
    """

    objects: tuple[ObjectHypothesisErrors, ...]


class StudyNotes:
    """Notes by part of the study (a method, say) and image.

    A value comes back as it is read from a file, whether or not it came from one, so
    that a study does not depend on whether it was cut off.

    Args:
        progress: where they are kept; None keeps them for this study only.
        earlier: what an earlier run left there.

    Raises:
        InputError: where it left something else.
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
                note["part"].fail("is no text")
            self._found[part, image] = note["found"]

    def __len__(self) -> int:
        return len(self._found)

    def has(self, part: str, image: ImageId) -> bool:
        """Whether there is a note that has not been taken."""
        return (part, image) in self._found

    def take(self, part: str, image: ImageId, kind: type[T]) -> T:
        """The value of a note, which is given once.

        Args:
            part: of the study.
            image: which.
            kind: the dataclass that the value is of.

        Raises:
            InputError: where the file holds something else.
        """
        return from_plain(self._found.pop((part, image)), kind)

    def add(self, part: str, image: ImageId, value: object) -> None:
        """Notes a value of a dataclass.

        Raises:
            InputError: where the file cannot be written, or is there no more.
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
