# SPDX-License-Identifier: MIT
"""One observation in, the poses of all its objects out: the pipeline in a page."""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from physim_drake.closing import Closing
from physim_drake.errors import InputError
from physim_drake.estimation.config import EstimationConfig, Method
from physim_drake.estimation.group_estimator import make_hypotheses
from physim_drake.estimation.image_estimate import ImageEstimate
from physim_drake.estimation.scale_check import (
    error_with_warning,
    size_warning,
    with_warning,
)
from physim_drake.estimation.scene_search import SceneSearch, SearchedScene
from physim_drake.estimation.stage_clock import StageClock
from physim_drake.estimation.workers import Worker, WorkerPool
from physim_drake.hypotheses.generation import PoseHypotheses
from physim_drake.hypotheses.pca import pca_poses
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.detection_alternatives import RivalConfig, rival_choices
from physim_drake.observation.observation import Detection, RgbdObservation, Segment
from physim_drake.observation.segmented_scene import Scene, prepare_scene
from physim_drake.observation.support_surface import (
    SupportSurface,
    find_support_surface,
    surface_at_height,
)
from physim_drake.poses import Array, nearest_rotation
from physim_drake.registration.registration_model import registration_model
from physim_drake.registration.trimmed_icp import (
    TrimmedIcpConfig,
    lcp_scores,
    trimmed_icp,
)
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from physim_drake.search.states import Placement

__all__ = ["EstimationConfig", "Method", "PoseEstimator", "Request", "estimate_scene"]

Request = tuple[RgbdObservation, Sequence[Detection], float | None]
"""What `PoseEstimator.estimate` takes: image, detections, height of the surface."""

_NOTHING: Placement = {}


class PoseEstimator(Closing):
    """Estimates scenes; keeps its workers warm from one image to the next.

    Args:
        library: the objects that may occur.
        config: method and settings; the defaults where it is None.

    Use it as a context manager, or call `close`.
    """

    def __init__(
        self,
        library: ObjectLibrary,
        config: EstimationConfig | None = None,
    ) -> None:
        self._library, self._config = library, config or EstimationConfig()
        self._pool = WorkerPool(library, self._config.steps, self._config.workers)
        self._prepared: tuple[tuple[object, ...], SupportSurface, Scene] | None = None

    def estimate(
        self,
        observation: RgbdObservation,
        detections: Sequence[Detection],
        surface_height: float | None = None,
        hypotheses: Sequence[PoseHypotheses] | None = None,
    ) -> SceneEstimate:
        """Estimates the pose of every detected object.

        Where a detector is not sure of an object, and neither is the image of its pose,
        it is tried where else the detector sees it (`Detection.instead`), too; what the
        image confirms most is taken.

        Args:
            observation: the image.
            detections: one for each object to find; one that the detector did not see
                (`Detection.unseen`) is not found.
            surface_height: z of the support surface in the world, m; found in the
                image if not given.
            hypotheses: what the method of that name returned for the same arguments,
                one for each detection; made here if not given.

        Raises:
            InputError: where the surface cannot be found, or an object has no model.
        """
        best = self._estimate(observation, detections, surface_height, hypotheses)
        if hypotheses is not None or not self._config.method.searches:
            return best
        stages = dict(best.stages)
        for rival in rival_choices(detections, observation.depth.shape):
            if self._settled(best):
                break
            other = self._estimate(observation, rival, surface_height, None)
            for stage, seconds in other.stages.items():
                stages[stage] = stages.get(stage, 0.0) + seconds
            if self._confirms(other, detections):
                best = max(best, other, key=_explained)
        return replace(best, stages=stages)

    def _estimate(
        self,
        observation: RgbdObservation,
        detections: Sequence[Detection],
        surface_height: float | None,
        hypotheses: Sequence[PoseHypotheses] | None,
    ) -> SceneEstimate:
        """The estimate with these detections alone."""
        clock = StageClock()
        surface, scene = self._prepare(observation, detections, surface_height)
        clock.lap("segments")
        self._pool.set_scene(scene)
        clock.lap("setup")
        large = [
            k
            for k, segment in enumerate(scene.segments)
            if len(segment.points) >= self._config.min_segment_points
        ]
        found = self._found(detections, large, hypotheses)
        clock.lap("hypotheses")
        if self._config.method.searches:
            search = SceneSearch(scene, self._library, self._pool, self._config, clock)
            searched = search.run(found)
        else:
            searched = SearchedScene(self._register(scene, large, found), {})
            clock.lap("hypotheses")
        confidences = self._pool.one(Worker.confidences, searched.placed)
        clock.lap("refinement")
        objects = tuple(
            self._object_estimate(
                observation, scene, surface.X_WS, k, searched, confidences
            )
            for k in range(len(detections))
        )
        estimate = SceneEstimate(
            objects,
            surface,
            str(self._config.method),
            clock.stages,
            searched.traces,
            tuple(detections),
        )
        warning = size_warning(observation, detections, self._library)
        return with_warning(estimate, warning)

    def _found(
        self,
        detections: Sequence[Detection],
        large: Sequence[int],
        hypotheses: Sequence[PoseHypotheses] | None,
    ) -> dict[int, PoseHypotheses]:
        """Hypotheses of the objects with large segments: those given, or new ones."""
        if hypotheses is not None:
            given = zip(detections, hypotheses, strict=True)
            return {
                k: h for k, (_, h) in enumerate(given) if k in large and len(h.X_SO)
            }
        if self._config.method.makes_hypotheses:
            requests = [(k, _NOTHING) for k in large]
            return make_hypotheses(self._pool, self._config, requests, 0)
        return {}

    def _confirms(
        self, estimate: SceneEstimate, detections: Sequence[Detection]
    ) -> bool:
        """Whether it is sure of all objects that the detector did not see."""
        return all(
            d.seen or not o.found or o.confidence >= self._config.confirmed
            for d, o in zip(detections, estimate.objects, strict=True)
        )

    def _settled(self, estimate: SceneEstimate) -> bool:
        """Whether the detector or the image is sure of each object."""
        return all(
            d.score >= RivalConfig.unsure or o.confidence >= self._config.settled
            for d, o in zip(estimate.detections, estimate.objects, strict=True)
        )

    def estimate_all(self, requests: Iterable[Request]) -> Iterator[SceneEstimate]:
        """Estimates one scene after the other."""
        for request in requests:
            yield self.estimate(*request)

    def hypotheses(
        self,
        observation: RgbdObservation,
        detections: Sequence[Detection],
        surface_height: float | None = None,
    ) -> tuple[Scene, list[PoseHypotheses]]:
        """The pose hypotheses of each detected object, as `estimate` makes them first.

        The arguments are those of `estimate`; the poses are in the frame S of the
        scene that is returned, too.
        """
        _, scene = self._prepare(observation, detections, surface_height)
        self._pool.set_scene(scene)
        seed = self._config.seed
        requests = [(k, _NOTHING, (seed, 0, k)) for k in range(len(detections))]
        return scene, self._pool.map(Worker.hypotheses, requests)

    def _prepare(
        self,
        observation: RgbdObservation,
        detections: Sequence[Detection],
        surface_height: float | None,
    ) -> tuple[SupportSurface, Scene]:
        # `estimate` often follows `hypotheses` with the very same objects.
        key = (observation, *detections, surface_height)
        if self._prepared is not None and _same(self._prepared[0], key):
            return self._prepared[1:]
        if surface_height is None:
            generator = np.random.default_rng(self._config.seed)
            seen = [d for d in detections if d.seen]
            try:
                surface = find_support_surface(observation, seen, generator)
            except InputError as error:
                warning = size_warning(observation, seen, self._library)
                raise error_with_warning(error, warning) from None
        else:
            surface = surface_at_height(observation, surface_height)
        self._prepared = key, surface, prepare_scene(observation, surface, detections)
        return self._prepared[1:]

    def close(self) -> None:
        """Ends the workers."""
        self._pool.close()

    def _register(
        self,
        scene: Scene,
        large: Sequence[int],
        found: Mapping[int, PoseHypotheses],
    ) -> dict[int, Array]:
        """Each object alone: its best hypothesis or principal axes, then ICP."""
        if self._config.method is Method.SUPER4PCS_ICP:
            starts = {k: h.X_SO[[int(h.lcp.argmax())]] for k, h in found.items()}
        else:
            starts = {
                k: pca_poses(self._library[scene.object_ids[k]], scene.segments[k])
                for k in large
            }
        placed = {}
        for k, X_SO in starts.items():
            segment = scene.segments[k]
            field_O = registration_model(
                self._library[segment.object_id]
            ).distance_field
            aligned, _ = trimmed_icp(
                field_O,
                X_SO,
                segment.points,
                segment.normals,
                TrimmedIcpConfig(keep=0.9, soft=False, cutoff=0.02),
            )
            scores = lcp_scores(
                field_O, aligned, segment.points, segment.normals, 0.005
            )
            placed[k] = aligned[int(scores.argmax())]
        return placed

    def _object_estimate(
        self,
        observation: RgbdObservation,
        scene: Scene,
        X_WS: Array,
        k: int,
        searched: SearchedScene,
        confidences: Mapping[int, float],
    ) -> ObjectEstimate:
        segment = scene.segments[k]
        name = self._library[segment.object_id].name
        reason = self._why_not_found(
            segment, confidences.get(k), k in searched.excluded
        )
        if reason:
            return ObjectEstimate(segment.object_id, name, None, None, 0.0, reason)
        X_SO = searched.placed[k].copy()
        X_SO[:3, :3] = nearest_rotation(X_SO[:3, :3])
        X_CO = scene.X_CS @ X_SO
        X_WO = X_WS @ X_SO if observation.X_WC is None else observation.X_WC @ X_CO
        confidence = confidences[k] * searched.shares.get(k, 1.0)
        return ObjectEstimate(segment.object_id, name, X_CO, X_WO, confidence, "")

    def _why_not_found(
        self, segment: Segment, confidence: float | None, excluded: bool
    ) -> str:
        """Empty where it is found; `confidence` is None where it has no pose.

        What is not shared yet counts: an object that is there is found, though it may
        be turned the other way.
        """
        if not segment.detection.seen:
            return "the detector did not see it"
        if excluded:
            return "no pose of it fits beside the other objects"
        if confidence is None:
            count, least = len(segment.points), self._config.min_segment_points
            if count < least:
                return f"its segment has {count} points, at least {least} are needed"
            return "no pose of it fits its segment"
        required = self._config.required_confidence
        if confidence < required:  # rounded down, to be below in print as well
            shown = math.floor(100 * confidence) / 100
            return f"confidence {shown:.2f} is below {required:.2f}"
        return ""


def estimate_scene(
    observation: RgbdObservation,
    library: ObjectLibrary,
    detections: Sequence[Detection],
    config: EstimationConfig | None = None,
    surface_height: float | None = None,
) -> ImageEstimate:
    """Estimates one scene; for many, keep a `PoseEstimator`.

    Args:
        observation: the image.
        library: models of the objects.
        detections: one for each object to find.
        config: method and settings; the defaults where it is None.
        surface_height: z of the support surface in the world, m; found if not given.

    Raises:
        InputError: where the surface cannot be found, or an object has no model.
    """
    with PoseEstimator(library, config) as estimator:
        estimate = estimator.estimate(observation, detections, surface_height)
    return ImageEstimate.of(estimate, observation, library)


def _explained(estimate: SceneEstimate) -> float:
    """How much of the estimate the image confirms, in objects."""
    return sum(o.confidence for o in estimate.objects)


def _same(one: Sequence[object], other: Sequence[object]) -> bool:
    """Whether two sequences hold the very same objects."""
    return len(one) == len(other) and all(map(operator.is_, one, other))
