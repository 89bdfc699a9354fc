# SPDX-License-Identifier: MIT
"""Shows each new estimate in Meshcat, over whatever else is shown there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydrake.geometry import Meshcat

from physim_drake.estimate import SceneEstimate
from physim_drake.objects import ObjectLibrary
from physim_drake.observation import RgbdObservation
from physim_drake.rendering.meshcat import draw_cloud, draw_estimate
from physim_drake.systems.stage import EACH_STEP, Look, Stage, TimingConfig


@dataclass(frozen=True)
class PoseVisualizerConfig:
    """What is shown, and how.

    Attributes:
        path: in Meshcat, below which everything is drawn.
        opacity: of the estimated models, 0..1.
        cloud: whether the observed points are shown.
        cloud_stride: one pixel in this many is, along rows and columns.
        point_size: of the points, m.
    """

    path: str = "/perception"
    opacity: float = 0.5
    cloud: bool = True
    cloud_stride: int = 2
    point_size: float = 0.002


class PoseVisualizer(Stage):
    """Draws the estimated models and the observed points, once for each look.

    .. pydrake_system::

        name: PoseVisualizer
        input_ports:
        - observation
        - scene_estimate

    Inputs: ``observation`` (Stamped[RgbdObservation]), ``scene_estimate``
    (Stamped[SceneEstimate]). Models are see-through and coloured from red to green by
    confidence; in Meshcat's tree each goes by its index, name and confidence. A look
    without an estimate removes them.

    Args:
        meshcat: where.
        library: the models.
        config: what, and how.
        timing: when.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        library: ObjectLibrary,
        config: PoseVisualizerConfig = PoseVisualizerConfig(),
        timing: TimingConfig = EACH_STEP,
    ) -> None:
        super().__init__(
            {"observation": RgbdObservation, "scene_estimate": SceneEstimate},
            {},
            timing,
            takes_errors=True,
        )
        self._meshcat, self._library, self._config = meshcat, library, config

    def work(self, look: Look) -> tuple[Any, ...]:
        """Draws a look."""
        config = self._config
        estimate: SceneEstimate | None = look["scene_estimate"]
        observation: RgbdObservation | None = look["observation"]
        if estimate is None or observation is None:
            self._meshcat.Delete(config.path)
            return ()
        draw_estimate(
            self._meshcat,
            f"{config.path}/estimate",
            estimate,
            self._library,
            config.opacity,
        )
        if config.cloud:
            surface, X_WC = estimate.surface, observation.X_WC
            draw_cloud(
                self._meshcat,
                f"{config.path}/cloud",
                observation,
                surface.X_WS @ surface.X_SC if X_WC is None else X_WC,
                config.cloud_stride,
                config.point_size,
            )
        return ()
