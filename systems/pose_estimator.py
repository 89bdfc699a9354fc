# SPDX-License-Identifier: MIT
"""Estimates the poses of all detected objects together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from physim_drake.estimation.preparation import PreparedScene
from physim_drake.hypotheses.generation import PoseHypotheses
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.scene_estimate import SceneEstimate
from physim_drake.systems.hypothesis_generator import SceneHypotheses
from physim_drake.systems.stage import EACH_STEP, Look, Stage, TimingConfig


class EstimationAlgorithm(Protocol):
    """What a `SceneEstimator` asks; `PoseEstimator` is one."""

    def estimate(
        self,
        observation: RgbdObservation,
        detections: Sequence[Detection],
        surface_height: float | None = None,
    ) -> SceneEstimate:
        """See `PoseEstimator.estimate`."""
        ...

    def estimate_prepared(
        self,
        prepared: PreparedScene,
        hypotheses: Sequence[PoseHypotheses] | None = None,
    ) -> SceneEstimate:
        """See `PoseEstimator.estimate_prepared`."""
        ...


class SceneEstimator(Stage):
    """Searches for the poses that explain each look best and could rest there.

    .. pydrake_system::

        name: SceneEstimator
        input_ports:
        - observation
        - detections
        - hypotheses (optional)
        output_ports:
        - scene_estimate

    Inputs: ``observation`` (Stamped[RgbdObservation]), ``detections``
    (Stamped[tuple[Detection, ...]]), ``hypotheses`` (Stamped[SceneHypotheses]); if
    that is not connected, the algorithm makes them. Output: ``scene_estimate``
    (Stamped[SceneEstimate]), poses in camera and world, m. An object that is detected
    but not found says so in the estimate; without a support surface there is no
    estimate, but an `error`.

    Args:
        algorithm: estimates the poses.
        surface_height: z of the support surface in the world, m; found in the image if
            None.
        timing: times at which inputs are read and results are shown.
    """

    def __init__(
        self,
        algorithm: EstimationAlgorithm,
        surface_height: float | None = None,
        timing: TimingConfig = EACH_STEP,
    ) -> None:
        super().__init__(
            {
                "observation": RgbdObservation,
                "detections": tuple[Detection, ...],
                "hypotheses": SceneHypotheses,
            },
            {"scene_estimate": SceneEstimate},
            timing,
            optional=("hypotheses",),
        )
        self._algorithm, self._surface_height = algorithm, surface_height

    def work(self, look: Look) -> tuple[Any, ...]:
        """Estimates the scene."""
        made: SceneHypotheses | None = look["hypotheses"]
        if made is not None:
            return (self._algorithm.estimate_prepared(made.prepared, made.objects),)
        return (
            self._algorithm.estimate(
                look["observation"], look["detections"], self._surface_height
            ),
        )
