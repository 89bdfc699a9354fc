# SPDX-License-Identifier: MIT
"""One observation in, the poses of all its objects out: the pipeline in a page."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from physim_drake.closing import Closing
from physim_drake.estimation.alternatives import best_alternative
from physim_drake.estimation.config import EstimationConfig, Method
from physim_drake.estimation.group_estimator import make_hypotheses
from physim_drake.estimation.image_estimate import ImageEstimate
from physim_drake.estimation.object_estimates import object_estimates
from physim_drake.estimation.per_object import (
    register_hypotheses,
    register_principal_axes,
)
from physim_drake.estimation.preparation import (
    EstimationRequest,
    PreparedScene,
    prepare,
)
from physim_drake.estimation.resizing import (
    resized_estimate,
    resized_hypotheses,
    resized_library,
    resized_record,
    resized_scene,
)
from physim_drake.estimation.scale_check import scale_warning, with_scale_warning
from physim_drake.estimation.scene_search import SceneSearch, SearchedScene
from physim_drake.estimation.stage_clock import StageClock
from physim_drake.estimation.workers import Worker, WorkerPool
from physim_drake.hypotheses.generation import PoseHypotheses
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.scene_estimate import SceneEstimate
from physim_drake.search.record import SearchRecord
from physim_drake.search.states import Placement

__all__ = [
    "EstimationConfig",
    "EstimationRequest",
    "Method",
    "PoseEstimator",
    "PreparedScene",
    "estimate_scene",
]

_NOTHING: Placement = {}


class PoseEstimator(Closing):
    """Estimates scenes; keeps its workers warm from one image to the next.

    Args:
        library: the objects that may occur.
        config: method and settings; the defaults if None.

    Use it as a context manager, or call `close`.
    """

    def __init__(
        self,
        library: ObjectLibrary,
        config: EstimationConfig | None = None,
    ) -> None:
        self._library, self._config = library, config or EstimationConfig()
        self._pool = WorkerPool(library, self._config.steps, self._config.workers)
        self._resized: tuple[float, PoseEstimator] | None = None

    def estimate(
        self,
        observation: RgbdObservation,
        detections: Sequence[Detection],
        surface_height: float | None = None,
    ) -> SceneEstimate:
        """Estimates the pose of every detected object.

        If the detector is not sure of an object, and neither is the image of its pose,
        it is also tried where else the detector sees it (`Detection.instead`); what the
        image confirms most is taken.

        Args:
            observation: the image.
            detections: one for each object to find; one that the detector did not see
                (`Detection.unseen`) is not found.
            surface_height: z of the support surface in the world, m; found in the
                image if None.

        Raises:
            InputError: if the surface cannot be found, or an object has no model.
        """

        def attempt(chosen: Sequence[Detection]) -> SceneEstimate:
            prepared = self.prepare(observation, chosen, surface_height)
            return self.estimate_prepared(prepared)

        shape = observation.depth.shape
        return best_alternative(attempt, detections, shape, self._config)

    def estimate_all(
        self, requests: Iterable[EstimationRequest]
    ) -> Iterator[SceneEstimate]:
        """Estimates one scene after the other."""
        for r in requests:
            yield self.estimate(r.observation, r.detections, r.surface_height)

    def prepare(
        self,
        observation: RgbdObservation,
        detections: Sequence[Detection],
        surface_height: float | None = None,
    ) -> PreparedScene:
        """Finds the support surface and the segments; arguments as of `estimate`.

        Raises:
            InputError: if the surface cannot be found.
        """
        request = EstimationRequest(observation, detections, surface_height)
        return prepare(request, self._library, self._config.seed)

    def hypotheses(self, prepared: PreparedScene) -> tuple[PoseHypotheses, ...]:
        """The pose hypotheses of each detected object, in the frame S of the scene.

        Args:
            prepared: scene that `prepare` returned.

        Raises:
            InputError: if an object has no model.
        """
        factor = prepared.factor
        if factor != 1:
            scene = resized_scene(prepared, 1 / factor)
            return resized_hypotheses(self._at(factor).hypotheses(scene), factor)
        self._pool.set_scene(prepared.segmented)
        seed = self._config.seed
        requests = [
            (k, _NOTHING, (seed, 0, k)) for k in range(len(prepared.detections))
        ]
        return tuple(self._pool.map(Worker.hypotheses, requests))

    def estimate_prepared(
        self,
        prepared: PreparedScene,
        hypotheses: Sequence[PoseHypotheses] | None = None,
        on_search: Callable[[SearchRecord], None] | None = None,
    ) -> SceneEstimate:
        """Estimates the pose of every object, each where it was detected.

        Args:
            prepared: scene that `prepare` returned.
            hypotheses: what the method of that name returned, one for each detection;
                made here if None.
            on_search: hears of each search of a group when it is done.

        Raises:
            InputError: if an object has no model.
        """
        if prepared.factor == 1:
            estimate = self._estimate(prepared, hypotheses, on_search)
        else:
            estimate = self._estimate_resized(prepared, hypotheses, on_search)
        wrong = scale_warning(prepared.observation, prepared.detections, self._library)
        warnings = [text for text in (wrong, prepared.surface.warning) if text]
        return with_scale_warning(estimate, "; ".join(warnings))

    def close(self) -> None:
        """Ends the workers."""
        self._pool.close()
        if self._resized is not None:
            self._resized[1].close()

    def _at(self, factor: float) -> PoseEstimator:
        """What estimates scenes whose lengths were divided by `factor`."""
        if self._resized is None or self._resized[0] != factor:
            if self._resized is not None:
                self._resized[1].close()
            library = resized_library(self._library, 1 / factor)
            self._resized = (factor, PoseEstimator(library, self._config))
        return self._resized[1]

    def _estimate_resized(
        self,
        prepared: PreparedScene,
        hypotheses: Sequence[PoseHypotheses] | None,
        on_search: Callable[[SearchRecord], None] | None,
    ) -> SceneEstimate:
        """The estimate of a scene whose objects are too small or large as it is."""
        factor = prepared.factor
        if hypotheses is not None:
            hypotheses = resized_hypotheses(hypotheses, 1 / factor)

        def tell(record: SearchRecord) -> None:
            if on_search is not None:
                on_search(resized_record(record, factor))

        scene = resized_scene(prepared, 1 / factor)
        estimate = self._at(factor)._estimate(scene, hypotheses, tell)
        return resized_estimate(estimate, prepared, factor)

    def _estimate(
        self,
        prepared: PreparedScene,
        hypotheses: Sequence[PoseHypotheses] | None,
        on_search: Callable[[SearchRecord], None] | None,
    ) -> SceneEstimate:
        """The estimate of a scene whose objects have a usual size."""
        clock = StageClock({"segments": prepared.seconds})
        self._pool.set_scene(prepared.segmented)
        clock.lap("setup")
        large = self._large_segments(prepared)
        found = self._hypotheses_of(large, hypotheses, len(prepared.detections))
        clock.lap("hypotheses")
        searched = self._searched(prepared, large, found, clock, on_search)
        confidences = self._pool.one(Worker.confidences, searched.placed)
        clock.lap("refinement")
        return SceneEstimate(
            object_estimates(
                prepared, searched, confidences, self._library, self._config
            ),
            prepared.surface,
            str(self._config.method),
            clock.stages,
            searched.traces,
            prepared.detections,
        )

    def _large_segments(self, prepared: PreparedScene) -> list[int]:
        """Indices of the segments that have enough points for an estimate."""
        return [
            k
            for k, segment in enumerate(prepared.segmented.segments)
            if len(segment.points) >= self._config.min_segment_points
        ]

    def _hypotheses_of(
        self, large: Sequence[int], given: Sequence[PoseHypotheses] | None, count: int
    ) -> dict[int, PoseHypotheses]:
        """Hypotheses of the objects with large segments: those given, or new ones."""
        if given is not None:
            pairs = zip(range(count), given, strict=True)
            return {k: h for k, h in pairs if k in large and len(h.X_SO)}
        if self._config.method.makes_hypotheses:
            requests = [(k, _NOTHING) for k in large]
            return make_hypotheses(self._pool, self._config, requests, 0)
        return {}

    def _searched(
        self,
        prepared: PreparedScene,
        large: Sequence[int],
        found: Mapping[int, PoseHypotheses],
        clock: StageClock,
        on_search: Callable[[SearchRecord], None] | None,
    ) -> SearchedScene:
        """All objects together, or each object alone, as the method is."""
        scene = prepared.segmented
        if self._config.method.searches:
            search = SceneSearch(
                scene, self._library, self._pool, self._config, clock, on_search
            )
            return search.run(found)
        if self._config.method.makes_hypotheses:
            placed = register_hypotheses(scene, self._library, found)
        else:
            placed = register_principal_axes(scene, self._library, large)
        clock.lap("hypotheses")
        return SearchedScene(placed)


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
        config: method and settings; the defaults if None.
        surface_height: z of the support surface in the world, m; found in the image if
            None.

    Raises:
        InputError: if the surface cannot be found, or an object has no model.
    """
    with PoseEstimator(library, config) as estimator:
        estimate = estimator.estimate(observation, detections, surface_height)
    return ImageEstimate.of(estimate, observation, library)
