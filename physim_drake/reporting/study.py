# SPDX-License-Identifier: MIT
"""Runs methods over a dataset and measures what the paper's tables and figures show."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from physim_drake.batch.detection_source import DetectionLookup, match_detections
from physim_drake.batch.images import ImageFailure, estimate_images
from physim_drake.batch.ray import make_estimator
from physim_drake.datasets.bop import BopDataset, GroundTruthPose, ImageId
from physim_drake.datasets.results import ResultRow
from physim_drake.estimation.estimator import EstimationConfig, Method, PoseEstimator
from physim_drake.evaluation.evaluate import MakeRenderer, evaluate_results
from physim_drake.evaluation.matching import match_detections_with_truth
from physim_drake.evaluation.report import EvaluationReport
from physim_drake.hypotheses.generation import PoseHypotheses
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.observation import Detection
from physim_drake.parallel.engine import Engine
from physim_drake.pose_errors import pose_error
from physim_drake.poses import Array, SymmetryGroup
from physim_drake.reporting.study_notes import (
    ImageHypothesisErrors,
    ImageOutcome,
    ObjectHypothesisErrors,
    StudyNotes,
)
from physim_drake.scene_estimate import SceneEstimate

SUCCESS_DEG, SUCCESS_CM = 6.0, 1.5
HYPOTHESES = "hypotheses"
"""Name of the part of a study that measures the quality of hypotheses."""


@dataclass(frozen=True)
class MethodRun:
    """One method's estimates of all images, and how good they are.

    Attributes:
        method: the method.
        name: name in the report; it names the detections if there are several kinds.
        estimates: estimate of each image, without its detections.
        report: errors of the estimates.
        curve: the anytime curve: (expansions, mean rotation error in degrees, mean
            translation error in cm), (N, 3); empty for methods that do not search.
    """

    method: Method
    name: str
    estimates: Mapping[ImageId, SceneEstimate]
    report: EvaluationReport
    curve: Array


@dataclass(frozen=True)
class SelectedPoseErrors:
    """One row of Table II: the errors of the pose that a metric selects.

    Attributes:
        metric: the candidate poses, and how one of them is selected.
        rotation_deg: mean over the objects, degrees.
        translation_cm: mean over the objects, cm.
    """

    metric: str
    rotation_deg: float
    translation_cm: float


@dataclass(frozen=True)
class HypothesisQuality:
    """Table II, and how often the representatives hold a good pose.

    Attributes:
        rows: one row for each metric.
        success: share of objects with a representative within 6 degrees and 1.5 cm.
        objects: number of objects.
        poses: mean number of scored poses for each object.
    """

    rows: tuple[SelectedPoseErrors, ...]
    success: float
    objects: int
    poses: float


@dataclass(frozen=True)
class Study:
    """Everything that is needed to run methods on a dataset.

    Attributes:
        dataset: dataset with ground truth.
        library: models of its objects.
        look_up: function that returns the detections of an image.
        source: name of their source, for messages.
        config: settings; each run replaces the method.
        progress: function that is called after each image with the name of the part.
        engine: engine on which methods run; the quality of hypotheses is always
            measured in this process.
        notes: results by part and image; those that are noted are not computed again.
    """

    dataset: BopDataset
    library: ObjectLibrary
    look_up: DetectionLookup
    source: str
    config: EstimationConfig
    progress: Callable[[str], None] = lambda _: None
    engine: Engine = Engine.LOCAL
    notes: StudyNotes = field(default_factory=StudyNotes)

    @property
    def images(self) -> list[ImageId]:
        """The images with targets."""
        targets = self.dataset.targets()
        return list(dict.fromkeys((t.scene_id, t.im_id) for t in targets))

    def detections(self, image: ImageId) -> Sequence[Detection]:
        """The objects to find in an image."""
        targets = self.dataset.targets()
        return match_detections(targets, image, self.look_up(image), self.dataset)

    def run(
        self, method: Method, make_renderer: MakeRenderer | None, name: str = ""
    ) -> MethodRun:
        """Estimates every image with one method.

        Args:
            method: the method.
            make_renderer: function that returns a renderer for a camera; if it is
                None, VSD is left out.
            name: name in the report, if not that of the method.
        """
        part = name or str(method)
        found = self._outcomes(method, part)
        estimates = {image: outcome.estimate for image, outcome in found.items()}
        rows = [
            ResultRow(*image, o.object_id, o.confidence, o.X_CO, outcome.seconds)
            for image, outcome in found.items()
            for o in outcome.estimate.objects
            if o.X_CO is not None
        ]
        report = evaluate_results(self.dataset, rows, self.library, make_renderer)
        return MethodRun(method, part, estimates, report, self._curve(found))

    def _outcomes(self, method: Method, part: str) -> dict[ImageId, ImageOutcome]:
        """The outcome for every image; estimates those that are not noted yet."""
        images = self.images
        todo = [image for image in images if not self.notes.has(part, image)]
        boxes: dict[ImageId, tuple[Array, ...]] = {}

        def detections(image: ImageId) -> Sequence[Detection]:
            """The objects to find in an image; their boxes are kept."""
            found = self.detections(image)
            boxes[image] = tuple(d.box for d in found)
            return found

        if todo:
            config = replace(self.config, method=method)
            with make_estimator(self.engine, self.library, config) as estimator:
                for result in estimate_images(
                    self.dataset, todo, detections, estimator
                ):
                    if isinstance(result, ImageFailure):
                        raise result.error
                    # Masks are most of an estimate, and are not needed.
                    estimate = replace(result.estimate, detections=())
                    outcome = ImageOutcome(
                        estimate, boxes.pop(result.image), result.seconds
                    )
                    self.notes.add(part, result.image, outcome)
                    self.progress(part)
        return {image: self.notes.take(part, image, ImageOutcome) for image in images}

    def hypothesis_quality(self) -> HypothesisQuality:
        """Table II of the paper on this dataset."""
        images = self.images
        todo = [image for image in images if not self.notes.has(HYPOTHESES, image)]
        if todo:
            with PoseEstimator(self.library, self.config) as estimator:
                for image in todo:
                    found = ImageHypothesisErrors(
                        tuple(
                            self._hypothesis_errors(hypotheses, X_CS, truth)
                            for hypotheses, X_CS, truth in self._hypotheses(
                                estimator, image
                            )
                        )
                    )
                    self.notes.add(HYPOTHESES, image, found)
                    self.progress(HYPOTHESES)
        noted = [
            self.notes.take(HYPOTHESES, image, ImageHypothesisErrors)
            for image in images
        ]
        return _quality([item for note in noted for item in note.objects])

    def _hypothesis_errors(
        self, hypotheses: PoseHypotheses, X_CS: Array, truth: GroundTruthPose
    ) -> ObjectHypothesisErrors:
        """Errors of an object's hypotheses."""
        rotation, translation = _errors(
            X_CS @ hypotheses.X_SO,
            truth.X_CO,
            self.library[truth.object_id].symmetry,
        )
        kept = hypotheses.representatives
        good = (rotation[kept] <= SUCCESS_DEG) & (translation[kept] <= SUCCESS_CM)
        return ObjectHypothesisErrors(
            {
                metric: (float(rotation[index]), float(translation[index]))
                for metric, index in _select(hypotheses, rotation, translation)
            },
            bool(good.any()),
            len(hypotheses.X_SO),
        )

    def _hypotheses(
        self, estimator: PoseEstimator, image: ImageId
    ) -> Iterator[tuple[PoseHypotheses, Array, GroundTruthPose]]:
        """Each detected object's hypotheses, X_CS, and true pose, if it has both."""
        observation = self.dataset.observation(*image)
        detections = self.detections(image)
        prepared = estimator.prepare(observation, detections)
        found = estimator.hypotheses(prepared)
        true = self._match(image, detections)
        for hypotheses, truth in zip(found, true, strict=True):
            if len(hypotheses.X_SO) and truth is not None:
                yield hypotheses, prepared.segmented.X_CS, truth

    def _match(
        self, image: ImageId, detections: Sequence[Detection]
    ) -> list[GroundTruthPose | None]:
        """The true object of each detection; None if it shows no true object."""
        truth = self.dataset.ground_truth(*image)
        intrinsics = self.dataset.intrinsics(*image)
        return match_detections_with_truth(detections, truth, intrinsics)

    def _curve(self, outcomes: Mapping[ImageId, ImageOutcome]) -> Array:
        """Mean errors of the best state so far against expansions, before refining.

        The first search of each group counts. Expansions before its first complete
        state count with the errors of that state.
        """
        grid = np.arange(1.0, self.config.search.expansions + 1)
        errors, count = np.zeros((len(grid), 2)), 0
        for image, outcome in outcomes.items():
            for curve in self._object_curves(image, outcome, grid):
                errors += curve
                count += 1
        if count == 0:
            return np.zeros((0, 3))
        return np.asarray(np.column_stack([grid, errors / count]), np.float64)

    def _object_curves(
        self, image: ImageId, outcome: ImageOutcome, grid: Array
    ) -> Iterator[Array]:
        """Rotation (deg) and translation (cm) of each searched object, (N, 2)."""
        pairs = zip(outcome.estimate.objects, outcome.boxes, strict=True)
        true = self._match(image, [Detection(o.object_id, box) for o, box in pairs])
        seen: set[int] = set()
        for trace in outcome.estimate.trace:
            if not trace.points or seen & set(trace.indices):
                continue
            seen |= set(trace.indices)
            steps = [expansion for expansion, _, _, _ in trace.points]
            at = np.maximum(np.searchsorted(steps, grid, side="right") - 1, 0)
            for n, k in enumerate(trace.indices):
                truth = true[k]
                if truth is None:
                    continue
                symmetry = self.library[truth.object_id].symmetry
                found = [
                    pose_error(truth.X_CO, poses[n], symmetry)
                    for _, _, _, poses in trace.points
                ]
                angles = np.degrees([e.rpy_mean for e in found])
                distances = 100 * np.array([e.translation for e in found])
                yield np.stack([angles[at], distances[at]], axis=1)


def _quality(found: Sequence[ObjectHypothesisErrors]) -> HypothesisQuality:
    """Table II from the errors of every object's hypotheses."""
    selected: dict[str, list[tuple[float, float]]] = {}
    for item in found:
        for metric, pair in item.selected.items():
            selected.setdefault(metric, []).append(pair)
    rows = tuple(
        SelectedPoseErrors(metric, *np.mean(pairs, axis=0).tolist())
        for metric, pairs in selected.items()
    )
    return HypothesisQuality(
        rows,
        float(np.mean([item.success for item in found])) if found else 0.0,
        len(found),
        float(np.mean([item.poses for item in found])) if found else 0.0,
    )


def _errors(
    X_CO: Array, X_CO_true: Array, symmetry: SymmetryGroup
) -> tuple[Array, Array]:
    """Rotation angles (deg) and distances (cm) of poses (N, 4, 4), each (N,)."""
    R_true = np.broadcast_to(X_CO_true[:3, :3], (len(X_CO), 3, 3))
    angle = symmetry.rotation_distance(R_true, X_CO[:, :3, :3])
    distance = np.linalg.norm(X_CO[:, :3, 3] - X_CO_true[:3, 3], axis=1)
    return np.degrees(angle), 100 * distance


def _select(
    hypotheses: PoseHypotheses, rotation: Array, translation: Array
) -> list[tuple[str, int]]:
    """The pose that each metric of Table II selects."""
    kept = hypotheses.representatives
    return [
        ("all hypotheses, best LCP", int(hypotheses.lcp.argmax())),
        ("all hypotheses, least rotation error", int(rotation.argmin())),
        ("all hypotheses, least translation error", int(translation.argmin())),
        ("representatives, best LCP", int(kept[hypotheses.lcp[kept].argmax()])),
        (
            "representatives, least rotation error",
            int(kept[rotation[kept].argmin()]),
        ),
        (
            "representatives, least translation error",
            int(kept[translation[kept].argmin()]),
        ),
    ]
