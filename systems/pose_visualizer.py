# SPDX-License-Identifier: MIT
"""Shows each new estimate in Meshcat, over whatever is already shown there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydrake.geometry import Meshcat

from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.observation import RgbdObservation
from physim_drake.rendering.meshcat import draw_cloud, draw_estimate
from physim_drake.scene_estimate import SceneEstimate
from physim_drake.systems.stage import EACH_STEP, Look, Stage, TimingConfig


@dataclass(frozen=True)
class PoseVisualizerConfig:
    """What is shown, and how.

    Attributes:
        path: path in Meshcat below which everything is drawn.
        opacity: opacity of the estimated models, 0..1.
        cloud: whether the observed points are shown.
        cloud_stride: one pixel in this many is, along rows and columns.
        point_size: size of the points, m.
        history: whether looks stay below ``<path>/look <number>`` when the next comes,
            hidden, so that a recording shows each from its time on.
    """

    path: str = "/perception"
    opacity: float = 0.5
    cloud: bool = True
    cloud_stride: int = 2
    point_size: float = 0.002
    history: bool = False


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
        meshcat: the Meshcat that shows them.
        library: the models.
        config: what, and how.
        timing: latency and poll period.
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
        path = self._make_room(look)
        estimate: SceneEstimate | None = look["scene_estimate"]
        observation: RgbdObservation | None = look["observation"]
        if estimate is None or observation is None:
            return ()
        draw_estimate(
            self._meshcat, f"{path}/estimate", estimate, self._library, config.opacity
        )
        if config.cloud:
            surface, X_WC = estimate.surface, observation.X_WC
            draw_cloud(
                self._meshcat,
                f"{path}/cloud",
                observation,
                surface.X_WS @ surface.X_SC if X_WC is None else X_WC,
                config.cloud_stride,
                config.point_size,
            )
        return ()

    def _make_room(self, look: Look) -> str:
        """Removes or hides the look before. Returns the path of the new one."""
        meshcat, config = self._meshcat, self._config
        if not config.history or look.number == 1:
            meshcat.Delete(config.path)
        if not config.history:
            return config.path
        before, path = (f"{config.path}/look {look.number - n}" for n in (1, 0))
        if meshcat.HasPath(before):
            meshcat.SetProperty(before, "visible", False, look.time)
        meshcat.SetProperty(path, "visible", False, 0.0)
        meshcat.SetProperty(path, "visible", True, look.time)
        return path
