# SPDX-License-Identifier: MIT
"""Helpers for integration tests against simulated or recorded ground truth.

from physim_drake.testing import assert_poses_close

estimate = estimate_scene(observation, library, detections)
assert_poses_close(estimate, truth, library, max_rotation_deg=3.0)
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from physim_drake.datasets.bop import GroundTruthPose
from physim_drake.evaluation.matching import (
    ObjectError,
    ObjectPose,
    object_errors,
    poses_in_camera,
)
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.scene_estimate import SceneEstimate
from physim_drake.scenes.generation import write_models
from physim_drake.scenes.recording import DatasetConfig, record_scene
from physim_drake.storage.scratch import ScratchFolder


@dataclass(frozen=True)
class ObservedScene:
    """A generated scene and one image of it.

    Attributes:
        observation: the image.
        detections: boxes as a detector would give them, one for each object.
        ground_truth: the true poses in that camera, in the same order.
    """

    observation: RgbdObservation
    detections: tuple[Detection, ...]
    ground_truth: tuple[GroundTruthPose, ...]


def observed_scene(
    library: ObjectLibrary,
    level: int = 1,
    seed: int = 0,
    objects: tuple[int, int] = (2, 4),
    noise: bool = True,
) -> ObservedScene:
    """Generates a settled scene and an image of it; the same seed gives the same one.

    Args:
        library: the objects to draw from.
        level: number of objects that depend on each other, 1 to 3.
        seed: seed of all random choices.
        objects: least and greatest number of objects.
        noise: True for a camera with noise.

    Raises:
        InputError: if no such scene can be made.
    """
    base = DatasetConfig()
    config = replace(
        base,
        seed=seed,
        levels=(level,),
        min_objects=objects[0],
        max_objects=objects[1],
        view=replace(base.view, noise=noise),
    )
    with ScratchFolder() as folder:
        files = write_models(library, folder.path)
        record = record_scene(library, config, 1, files)
    view = record.views[0]
    truth = tuple(
        GroundTruthPose(object_id, X_CO, float(visible), level)
        for object_id, X_CO, visible, level in zip(
            record.scene.object_ids,
            view.X_CO,
            view.visible_fractions,
            record.scene.levels,
            strict=True,
        )
    )
    detections = tuple(_detection(entry) for entry in record.detections[0])
    return ObservedScene(view.observation, detections, truth)


def _detection(entry: Mapping[str, Any]) -> Detection:
    """The detection of an entry of a detections file."""
    left, top, width, height = entry["bbox"]
    box = np.array([left, top, left + width, top + height])
    return Detection(entry["category_id"], box, entry["score"])


def compare_poses(
    estimate: SceneEstimate,
    ground_truth: Iterable[GroundTruthPose],
    library: ObjectLibrary,
) -> tuple[ObjectError, ...]:
    """Compares every true object with the estimate of it.

    Several instances of one object are matched one to one so that their distances add
    up to the least.

    Args:
        estimate: scene with poses in the camera.
        ground_truth: true poses in the same camera.
        library: models of the objects, for names and symmetries.

    Returns:
        one error for each true object, in their order.
    """
    true = [
        ObjectPose(library[t.object_id].name, t.object_id, t.X_CO) for t in ground_truth
    ]
    return object_errors(poses_in_camera(estimate), true, library)


def assert_poses_close(
    estimate: SceneEstimate,
    ground_truth: Iterable[GroundTruthPose],
    library: ObjectLibrary,
    max_rotation_deg: float = 5.0,
    max_translation_m: float = 0.01,
) -> None:
    """Asserts that every true object was found within the given errors.

    Args:
        estimate: scene with poses in the camera.
        ground_truth: true poses in the same camera.
        library: models of the objects, for names and symmetries.
        max_rotation_deg: largest rotation angle, least over the symmetries.
        max_translation_m: largest distance of the origins.

    Raises:
        AssertionError: if an object is missing or off; names each, and by how much.
    """
    compared = compare_poses(estimate, ground_truth, library)
    wrong = [c for c in compared if not c.within(max_rotation_deg, max_translation_m)]
    if wrong:
        listed = "\n  ".join(str(c) for c in wrong)
        raise AssertionError(
            f"{len(wrong)} of {len(compared)} objects are farther off than "
            f"{max_rotation_deg:g} deg or {1000 * max_translation_m:g} mm:\n  {listed}"
        )
