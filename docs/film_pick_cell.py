# SPDX-License-Identifier: MIT
"""Films an episode of the pick cell, as the README shows it.

python docs/film_pick_cell.py examples/scenarios/clutter.yaml --episode 2
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from PIL import Image, ImageDraw
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    LightParameter,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context
from pydrake.systems.sensors import CameraInfo

from physim_drake.episodes.runner import EpisodeRunner
from physim_drake.objects.model import ObjectLibrary
from physim_drake.picking.scenario import load_scenario
from physim_drake.picking.viewpoints import look_at
from physim_drake.poses import Array
from physim_drake.rendering.overlay import draw_overlay
from physim_drake.systems.pick_cell import PickCell

SCENARIO = Path("examples/scenarios/clutter.yaml")
WIDTH, HEIGHT, INSET = 600, 420, 200
FROM, TO = np.array([1.7, -1.5, 1.0]), np.array([-0.2, 0.15, 0.1])
"""The film camera and what it looks at, from the middle of the pick area, m."""


class Film:
    """Takes a picture of the cell every so many steps of an episode.

    The last look stands in the corner, with the estimated models drawn over it.

    Args:
        library: models of the objects.
        X_WV: pose of the film camera, (4, 4), z forward.
        every: steps of 0.1 s.
    """

    def __init__(self, library: ObjectLibrary, X_WV: Array, every: int) -> None:
        self._library, self._X_WV, self._every = library, RigidTransform(X_WV), every
        self._step, self._look, self._inset = 0, 0, None
        self.pictures: list[Image.Image] = []

    def __call__(self, cell: PickCell, context: Context) -> None:
        """Takes a picture, if it is time for one."""
        self._step += 1
        if (self._step - 1) % self._every:
            return
        picture = self._view(cell, context)
        self._update_inset(cell, context)
        if self._inset is not None:
            picture.paste(self._inset, (WIDTH - self._inset.width, 0))
        phase = cell.task.task_state(cell.task.GetMyContextFromRoot(context)).phase
        text = f"{context.get_time():4.1f} s  {phase}"
        ImageDraw.Draw(picture).text((10, 8), text, fill=(30, 30, 30), font_size=16)
        self.pictures.append(picture)

    def write(self, path: Path, frame_ms: int) -> None:
        """Writes the film as an animated WebP that starts over."""
        first, *others = self.pictures
        first.save(
            path,
            save_all=True,
            append_images=others,
            duration=frame_ms,
            loop=0,
            quality=45,
            method=6,
        )

    def _view(self, cell: PickCell, context: Context) -> Image.Image:
        graph: Any = cell.diagram.GetSubsystemByName("scene_graph")
        own = graph.GetMyMutableContextFromRoot(context)
        if not graph.HasRenderer(own, "film"):
            lights = [
                LightParameter(
                    type="directional", frame="world", direction=d, intensity=i
                )
                for d, i in (([-0.5, 0.6, -1.0], 1.0), ([-0.9, -0.2, -0.3], 0.5))
            ]
            params = RenderEngineVtkParams(
                backend="EGL", default_clear_color=[0.93, 0.94, 0.95], lights=lights
            )
            graph.AddRenderer(own, "film", MakeRenderEngineVtk(params))
        core = RenderCameraCore(
            "film",
            CameraInfo(WIDTH, HEIGHT, np.radians(36.0)),
            ClippingRange(0.05, 10.0),
            RigidTransform(),
        )
        query = graph.get_query_output_port().Eval(own)
        image = query.RenderColorImage(
            ColorRenderCamera(core, False), SceneGraph.world_frame_id(), self._X_WV
        )
        return Image.fromarray(image.data[:, :, :3].copy())

    def _update_inset(self, cell: PickCell, context: Context) -> None:
        perception = cell.perception
        own = perception.GetMyContextFromRoot(context)
        estimate = perception.GetOutputPort("scene_estimate").Eval(own)
        if estimate.number == self._look or estimate.value is None:
            return
        observation = perception.GetOutputPort("observation").Eval(own).value
        drawn = draw_overlay(observation, estimate.value, self._library)
        half = Image.fromarray(drawn[:, : observation.depth.shape[1]])
        self._look = estimate.number
        self._inset = half.resize((INSET, INSET * half.height // half.width))


def main(
    scenario: Annotated[Path, typer.Argument()] = SCENARIO,
    out: Path = Path("docs/images/pick-cell.webp"),
    episode: int = 2,
    every: int = 3,
    frame_ms: int = 100,
) -> None:
    """Films one episode of a scenario."""
    with EpisodeRunner(load_scenario(scenario)) as runner:
        middle = runner.geometry.X_WA[:3, 3]
        film = Film(runner.library, look_at(middle + FROM, middle + TO), every)
        result = runner.run(episode, film)
    film.write(out, frame_ms)
    typer.echo(f"{out}: {len(film.pictures)} pictures; {result.end}")


if __name__ == "__main__":
    typer.run(main)
