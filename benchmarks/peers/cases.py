# SPDX-License-Identifier: MIT
"""The segments that all methods get, and where their objects truly are."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from physim_drake.batch.detection_source import DetectionLookup, match_detections
from physim_drake.datasets.bop import BopDataset, GroundTruthPose, ImageId, Target
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary, ObjectModel
from physim_drake.observation.observation import Detection, RgbdObservation, Segment
from physim_drake.observation.segmented_scene import SegmentedScene, prepare_scene
from physim_drake.observation.support_surface import find_support_surface
from physim_drake.poses import Array, exp_pose, inverse
from physim_drake.scenes.dataset import generate_dataset
from physim_drake.scenes.recording import DatasetConfig

LEAST_POINTS = 30
T = TypeVar("T")


@dataclass(frozen=True)
class Case:
    """One object to find.

    Attributes:
        name: of the image it is in.
        index: of its segment in the scene.
        model: what it is.
        scene: the image.
        X_SO: where it truly is, (4, 4).
    """

    name: str
    index: int
    model: ObjectModel
    scene: SegmentedScene
    X_SO: Array

    @property
    def segment(self) -> Segment:
        """Its points and normals, in S."""
        return self.scene.segments[self.index]

    @property
    def key(self) -> tuple[str, int]:
        """Tells it from all others."""
        return self.name, self.index

    def errors(self, X_SO: Array) -> tuple[Array, Array]:
        """How far poses (N, 4, 4) are off, symmetry folded: deg (N,) and cm (N,)."""
        R_true = np.broadcast_to(self.X_SO[:3, :3], (len(X_SO), 3, 3))
        angle = self.model.symmetry.rotation_distance(R_true, X_SO[:, :3, :3])
        distance = np.linalg.norm(X_SO[:, :3, 3] - self.X_SO[:3, 3], axis=1)
        return np.degrees(angle), 100 * distance

    def perturbed(self, degrees: float, metres: float, seed: int) -> Array:
        """The true pose, turned and shifted by so much about the object's middle."""
        generator = np.random.default_rng([seed, self.index, len(self.segment.points)])
        axes = generator.standard_normal((2, 3))
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        X = exp_pose(np.concatenate([np.radians(degrees) * axes[0], np.zeros(3)]))
        middle = self.X_SO[:3, :3] @ self.model.mesh.bounds.mean(axis=0)
        middle += self.X_SO[:3, 3]
        moved = self.X_SO.copy()
        moved[:3, :3] = X[:3, :3] @ self.X_SO[:3, :3]
        moved[:3, 3] = X[:3, :3] @ (self.X_SO[:3, 3] - middle) + middle
        moved[:3, 3] += metres * axes[1]
        return moved


class PartOfDataset(BopDataset):
    """Some images of a dataset.

    Args:
        root: its folder.
        limit: only so many images, spread over all of them; 0 for all.
        models: folder of its models.
    """

    def __init__(self, root: Path, limit: int, models: Path | None = None) -> None:
        super().__init__(root, models=models)
        targets = super().targets()
        images = list(dict.fromkeys((t.scene_id, t.im_id) for t in targets))
        if 0 < limit < len(images):
            images = [images[k * len(images) // limit] for k in range(limit)]
        self.chosen = images
        self._part = [t for t in targets if (t.scene_id, t.im_id) in set(images)]

    def targets(self, path: Path | None = None) -> list[Target]:
        """Those of the chosen images."""
        return self._part


def generated_dataset(root: Path, scenes: int, seed: int) -> Path:
    """Scenes of two to four of the bundled objects; kept for the next run."""
    root = root / f"scenes-{scenes}-{seed}"
    library = ObjectLibrary.load(APC11)
    generate_dataset(root, library, DatasetConfig(seed=seed), scenes, resume=True)
    return root


def image_cases(
    dataset: BopDataset,
    library: ObjectLibrary,
    image: ImageId,
    look_up: DetectionLookup,
    source: str,
) -> tuple[RgbdObservation, Sequence[Detection], list[Case]]:
    """One image's detections, and a case for each segment of enough points."""
    observation = dataset.observation(*image)
    detections = match_detections(dataset.targets(), image, look_up(image), dataset)
    surface = find_support_surface(observation, detections, np.random.default_rng(0))
    scene = prepare_scene(observation, surface, detections)
    truths = dataset.ground_truth(*image)
    cases = [
        Case(
            f"{image[0]}/{image[1]}",
            k,
            library[detection.object_id],
            scene,
            inverse(scene.X_CS) @ _truth(truths, detection, observation).X_CO,
        )
        for k, detection in enumerate(detections)
        if len(scene.segments[k].points) >= LEAST_POINTS
    ]
    return observation, detections, cases


def _truth(
    truths: Sequence[GroundTruthPose], detection: Detection, image: RgbdObservation
) -> GroundTruthPose:
    """The true pose that projects nearest to the middle of a detection."""
    middle = (detection.box[:2] + detection.box[2:]) / 2
    return min(
        (t for t in truths if t.object_id == detection.object_id),
        key=lambda t: float(
            np.linalg.norm(image.intrinsics.project(t.X_CO[:3, 3]) - middle)
        ),
    )


def clocked(function: Callable[..., T], *arguments: Any) -> tuple[T, float]:
    """A call's result, and the processor's seconds that it took."""
    start = time.process_time()
    result = function(*arguments)
    return result, time.process_time() - start
