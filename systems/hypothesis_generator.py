# SPDX-License-Identifier: MIT
"""Makes the pose hypotheses of each detected object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from physim_drake.estimation.preparation import PreparedScene
from physim_drake.hypotheses.generation import PoseHypotheses
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.systems.stage import EACH_STEP, Look, Stage, TimingConfig


@dataclass(frozen=True)
class SceneHypotheses:
    """The pose hypotheses of all objects in one image.

    Attributes:
        prepared: the image cut into segments; poses are in the frame S of its surface.
        objects: one for each detection, in their order.
    """

    prepared: PreparedScene
    objects: tuple[PoseHypotheses, ...]


class HypothesisAlgorithm(Protocol):
    """What a `HypothesisGenerator` asks; `PoseEstimator` is one."""

    def prepare(
        self,
        observation: RgbdObservation,
        detections: Sequence[Detection],
        surface_height: float | None = None,
    ) -> PreparedScene:
        """See `PoseEstimator.prepare`."""
        ...

    def hypotheses(self, prepared: PreparedScene) -> Sequence[PoseHypotheses]:
        """See `PoseEstimator.hypotheses`."""
        ...


class HypothesisGenerator(Stage):
    """Makes pose hypotheses of each look's detections.

    .. pydrake_system::

        name: HypothesisGenerator
        input_ports:
        - observation
        - detections
        output_ports:
        - hypotheses

    Inputs: ``observation`` (Stamped[RgbdObservation]), ``detections``
    (Stamped[tuple[Detection, ...]]). Output: ``hypotheses``
    (Stamped[SceneHypotheses]).

    Args:
        algorithm: makes them; give it to the estimator too, so that workers are shared.
        surface_height: z of the support surface in the world, m; found in the image if
            None.
        timing: times at which inputs are read and results are shown.
    """

    def __init__(
        self,
        algorithm: HypothesisAlgorithm,
        surface_height: float | None = None,
        timing: TimingConfig = EACH_STEP,
    ) -> None:
        super().__init__(
            {"observation": RgbdObservation, "detections": tuple[Detection, ...]},
            {"hypotheses": SceneHypotheses},
            timing,
        )
        self._algorithm, self._surface_height = algorithm, surface_height

    def work(self, look: Look) -> tuple[Any, ...]:
        """Makes the hypotheses."""
        prepared = self._algorithm.prepare(
            look["observation"], look["detections"], self._surface_height
        )
        objects = self._algorithm.hypotheses(prepared)
        return (SceneHypotheses(prepared, tuple(objects)),)
