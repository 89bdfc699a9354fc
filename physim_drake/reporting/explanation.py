# SPDX-License-Identifier: MIT
"""Everything about how one image was estimated, gathered for explaining it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from physim_drake.batch.detection_source import DetectionLookup, match_detections
from physim_drake.datasets.bop import BopDataset, ImageId, Target
from physim_drake.errors import InputError
from physim_drake.estimation.alternatives import best_alternative
from physim_drake.estimation.config import EstimationConfig, Method
from physim_drake.estimation.estimator import PoseEstimator
from physim_drake.estimation.preparation import EstimationRequest, PreparedScene
from physim_drake.evaluation.matching import match_detections_with_truth
from physim_drake.hypotheses.generation import PoseHypotheses
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.observation.segmented_scene import SegmentedScene
from physim_drake.pose_errors import PoseError, pose_error
from physim_drake.poses import Array
from physim_drake.rendering.depth import DepthRenderer
from physim_drake.rendering.overlay import render_labels
from physim_drake.scene_estimate import SceneEstimate
from physim_drake.search.dependency import DependencyGraph, dependency_graph
from physim_drake.search.record import SearchRecord
from physim_drake.search.states import Confirmation, confirmations


@dataclass(frozen=True)
class Explanation:
    """One image, and what every stage made of it.

    Attributes:
        image: scene id and image id.
        observation: the image.
        detections: the objects to find; everything below goes by their index.
        library: models of the objects.
        config: settings of the estimate.
        surface_height: z of the support surface in the world, m, if it was given.
        scene: segments and support frame.
        hypotheses: hypotheses of each object, maybe none.
        graph: order in which objects are placed.
        searches: the first search of each group.
        estimate: poses that came of it all.
        truth: the true X_CO (4, 4) of each object, None if it is not known.
        seconds: seconds by stage.
    """

    image: ImageId
    observation: RgbdObservation
    detections: tuple[Detection, ...]
    library: ObjectLibrary
    config: EstimationConfig
    surface_height: float | None
    scene: SegmentedScene
    hypotheses: tuple[PoseHypotheses, ...]
    graph: DependencyGraph
    searches: tuple[SearchRecord, ...]
    estimate: SceneEstimate
    truth: tuple[Array | None, ...]
    seconds: Mapping[str, float]

    @property
    def names(self) -> tuple[str, ...]:
        """What to call each object; those of a kind are numbered."""
        kinds = [self.library[d.object_id].name for d in self.detections]
        return tuple(
            f"{kind} ({kinds[: k + 1].count(kind)})" if kinds.count(kind) > 1 else kind
            for k, kind in enumerate(kinds)
        )

    def error(self, k: int, X_CO: Array | None) -> PoseError | None:
        """Of a pose of object `k`; None if that or the truth is not known."""
        truth = self.truth[k]
        if truth is None or X_CO is None:
            return None
        model = self.library[self.detections[k].object_id]
        return pose_error(truth, X_CO, model.symmetry)

    def nearest_representative(self, k: int) -> int | None:
        """Which of object `k`'s representatives is nearest to the truth."""
        errors = [self.error(k, X) for X in self.scene.X_CS @ self.hypotheses[k].poses]
        sizes = [error_size(error) for error in errors if error is not None]
        return int(np.argmin(sizes)) if sizes else None

    def searched_pose(self, k: int) -> Array | None:
        """X_CO of object `k` in the best state of its group's first search."""
        for record in self.searches:
            if k in record.order and record.result.states:
                poses = record.result.states[0].poses
                return np.asarray(self.scene.X_CS @ poses[record.order.index(k)])
        return None

    def confirmations(self, renderer: DepthRenderer) -> list[Confirmation]:
        """How well the image confirms each object; what is not found is not drawn."""
        drawn = render_labels(self.estimate.objects, renderer)
        indices = range(len(self.detections))
        tolerance = self.config.steps.expansion.depth_tolerance_m
        confirmed = confirmations(
            self.scene, drawn.depth, drawn.labels, indices, tolerance
        )
        return [confirmed[k] for k in indices]


def error_size(error: PoseError) -> float:
    """Rotation and translation together, in units of 5 degrees and 1 cm."""
    return error.geodesic_deg / 5 + error.translation_mm / 10


def explain_image(
    dataset: BopDataset,
    image: ImageId,
    look_up: DetectionLookup,
    source: str,
    library: ObjectLibrary,
    config: EstimationConfig,
    surface_height: float | None = None,
    targets: Sequence[Target] | None = None,
    told: Callable[[str], None] = lambda _: None,
) -> Explanation:
    """Estimates one image and keeps what each stage gave.

    Args:
        dataset: holds the image.
        image: scene id and image id.
        look_up: gives the image's detections.
        source: name of where they come from, for messages.
        library: models of the objects.
        config: settings of the estimate; the method must be `physim-mcts`.
        surface_height: z of the support surface in the world, m; found if None.
        targets: objects to look for; the dataset's own if None.
        told: hears, whenever a step is done, the name of the next one.

    Raises:
        InputError: if the image cannot be used.
    """
    if config.method is not Method.PHYSIM_MCTS:
        raise InputError("method", f"is {config.method}", "explain physim-mcts")
    wanted = dataset.targets() if targets is None else targets
    observation = dataset.observation(*image)
    detections = match_detections(wanted, image, look_up(image), dataset)
    attempts: list[_Attempt] = []

    def attempt(chosen: Sequence[Detection]) -> SceneEstimate:
        """Estimates with these detections, and keeps how."""
        request = EstimationRequest(observation, chosen, surface_height)
        attempts.append(_attempt(estimator, request, None if attempts else told))
        return attempts[-1].estimate

    with PoseEstimator(library, config) as estimator:
        shape = observation.depth.shape
        best = best_alternative(attempt, detections, shape, config)
    (way,) = (a for a in attempts if a.estimate.objects is best.objects)
    scene = way.prepared.segmented
    true = match_detections_with_truth(
        way.prepared.detections, dataset.ground_truth(*image), observation.intrinsics
    )
    return Explanation(
        image,
        observation,
        way.prepared.detections,
        library,
        config,
        surface_height,
        scene,
        way.hypotheses,
        dependency_graph(scene.segments, scene.X_CS),
        way.first_searches(),
        way.estimate,
        tuple(None if t is None else t.X_CO for t in true),
        _seconds(way.estimate, way.seconds),
    )


@dataclass(frozen=True)
class _Attempt:
    """An estimate, and how it came about.

    Attributes:
        prepared: the image with the detections of this estimate.
        hypotheses: hypotheses of each object.
        seconds: time taken for them, s.
        searches: searches of groups, in their order.
        estimate: poses that came of it all.
    """

    prepared: PreparedScene
    hypotheses: tuple[PoseHypotheses, ...]
    seconds: float
    searches: tuple[SearchRecord, ...]
    estimate: SceneEstimate

    def first_searches(self) -> tuple[SearchRecord, ...]:
        """The first search of each group; those of some of its objects come later."""
        first: list[SearchRecord] = []
        seen: set[int] = set()
        for record in self.searches:
            if seen.isdisjoint(record.order):
                first.append(record)
                seen |= {*record.order}
        return tuple(first)


def _attempt(
    estimator: PoseEstimator,
    request: EstimationRequest,
    told: Callable[[str], None] | None,
) -> _Attempt:
    """Estimates a scene and keeps what each stage gave."""
    prepared = estimator.prepare(
        request.observation, request.detections, request.surface_height
    )
    start = time.monotonic()
    hypotheses = estimator.hypotheses(prepared)
    seconds = time.monotonic() - start
    if told is not None:
        told("estimating")
    searches: list[SearchRecord] = []
    estimate = estimator.estimate_prepared(prepared, hypotheses, searches.append)
    return _Attempt(prepared, hypotheses, seconds, tuple(searches), estimate)


def _seconds(estimate: SceneEstimate, hypotheses: float) -> dict[str, float]:
    """By stage; preparing the scene belongs to the hypotheses, made before it, s."""
    seconds = {"hypotheses": hypotheses}
    for stage, taken in estimate.stages.items():
        name = stage if stage in ("search", "refinement") else "hypotheses"
        seconds[name] = seconds.get(name, 0.0) + taken
    return seconds
