# SPDX-License-Identifier: MIT
"""Labels for what a detector missed, from what it saw from elsewhere.

A robot looks at a scene from several places. In some views the detector finds an object
well enough for its pose to be estimated. Views that agree on a pose make it certain.
Drawn into all views, the certain poses say what the detector should have found there
(Mitash et al., "A Self-supervised Learning System for Object Detection using Physics
Simulation and Multi-view Pose Estimation", IROS 2017).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from physim_drake.datasets.bop import mask_bounds
from physim_drake.datasets.bop_writer import BopImage, write_bop_scene
from physim_drake.errors import InputError
from physim_drake.estimation.estimator import PoseEstimator
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.poses import Array
from physim_drake.self_learning.agreement import (
    AgreedObject,
    AgreementConfig,
    EstimatedView,
    agreed_objects,
)
from physim_drake.self_learning.projection import (
    ObjectArea,
    ProjectedObjects,
    labelled_image,
    project_objects,
    unknown_pixels,
)
from physim_drake.storage.files import fill_folder

_FOUND = 0.5  # overlap of boxes from which on an object was found


@dataclass(frozen=True)
class SelfLearningConfig:
    """What is taken for certain.

    Attributes:
        agreement: limits within which views agree.
        margin: difference up to which depths agree, m.
        max_refuted: share of an object that views may see through before it is dropped.
        min_pixels: visible pixels below which an object gets no label in an image.
    """

    agreement: AgreementConfig = field(default_factory=AgreementConfig)
    margin: float = 0.008
    max_refuted: float = 0.15
    min_pixels: int = 100


@dataclass(frozen=True)
class LabelledScene:
    """What was learnt from a scene.

    Attributes:
        objects: objects whose poses are certain.
        images: labelled views that show any of them.
        labels: number of labels in all images.
        missed: number of labels that the detector had not found.
    """

    objects: tuple[AgreedObject, ...]
    images: tuple[BopImage, ...]
    labels: int
    missed: int


class SceneLearner:
    """Makes labels from views of scenes.

    Args:
        library: models of the objects.
        estimator: estimator of their poses.
        area: part of the support surface that the objects stand on.
        config: limits of what is taken for certain.
    """

    def __init__(
        self,
        library: ObjectLibrary,
        estimator: PoseEstimator,
        area: ObjectArea,
        config: SelfLearningConfig = SelfLearningConfig(),
    ) -> None:
        self._library, self._estimator = library, estimator
        self._area, self._config = area, config

    def estimated(
        self, observation: RgbdObservation, detections: Sequence[Detection]
    ) -> EstimatedView:
        """Estimates poses in one view from what the detector found there.

        Args:
            observation: image with colour and a camera pose.
            detections: detections to trust, one per place.

        Raises:
            InputError: if the camera's pose or the colour is missing.
        """
        if observation.X_WC is None or observation.color is None:
            raise InputError(
                observation.name,
                "has no camera pose or no colour",
                "give both to learn from the image",
            )
        if not detections:
            return EstimatedView(observation, (), ())
        height = float(self._area.X_WA[2, 3])
        estimate = self._estimator.estimate(observation, detections, height)
        return EstimatedView(observation, tuple(detections), estimate.objects)

    def labelled(self, views: Sequence[EstimatedView]) -> LabelledScene:
        """Labels all views of a scene by what they agree on."""
        config = self._config
        agreed = agreed_objects(views, self._library, config.agreement)
        projected = self._projected(agreed, views)
        refuted = _refuted(projected, len(agreed))
        objects = tuple(
            o
            for o, share in zip(agreed, refuted, strict=True)
            if share <= config.max_refuted
        )
        if len(objects) < len(agreed):
            projected = self._projected(objects, views)
        images, labels, missed = [], 0, 0
        for view, drawn in zip(views, projected, strict=True):
            unknown = unknown_pixels(
                drawn, view.observation, view.detections, self._area
            )
            image = labelled_image(
                objects, drawn, view.observation, unknown, config.min_pixels
            )
            if image.object_ids:
                images.append(image)
                labels += len(image.object_ids)
                missed += _missed(image, view.detections)
        return LabelledScene(objects, tuple(images), labels, missed)

    def _projected(
        self, objects: Sequence[AgreedObject], views: Sequence[EstimatedView]
    ) -> list[ProjectedObjects]:
        return [
            project_objects(
                objects, self._library, view.observation, self._config.margin
            )
            for view in views
        ]


def box_overlap(one: Array, other: Array) -> float:
    """Intersection over union of two boxes (4,)."""
    low, high = np.maximum(one[:2], other[:2]), np.minimum(one[2:], other[2:])
    common = float(np.prod(np.maximum(high - low, 0.0)))
    areas = sum(float(np.prod(box[2:] - box[:2])) for box in (one, other))
    return common / max(areas - common, 1e-9)


def write_labelled_scene(
    split: Path, scene_id: int, images: Sequence[BopImage], library: ObjectLibrary
) -> None:
    """Writes the images of a scene below `split` in BOP layout, whole or not at all.

    Raises:
        InputError: if they cannot be written.
    """
    names = {object_id: library[object_id].name for object_id in library}
    with fill_folder(split / f"{scene_id:06d}") as scratch:
        write_bop_scene(scratch, images, names)


def _refuted(projected: Sequence[ProjectedObjects], count: int) -> Array:
    """The share of each object that the views together see through, (count,)."""
    through, measured = np.zeros(count), np.zeros(count)
    for drawn in projected:
        through += drawn.refuted * drawn.measured
        measured += drawn.measured
    return np.asarray(through / np.maximum(measured, 1))


def _missed(image: BopImage, detections: Sequence[Detection]) -> int:
    """How many of an image's labels the detector had not found."""
    return sum(
        not any(
            d.object_id == object_id
            and box_overlap(d.box, mask_bounds(visible)) >= _FOUND
            for d in detections
        )
        for object_id, visible in zip(image.object_ids, image.visible, strict=True)
    )
