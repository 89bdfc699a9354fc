# SPDX-License-Identifier: MIT
"""Looking at the pick area from all around, as far as the arm gets.

A conditions file says under which lights, and with which camera:

    camera: d415
    renderer:
      lights:
      - {type: spot, frame: world, position: [0.6, -1.0, 1.6], direction: [0, 1, -0.8],
         color: {rgba: [1.0, 0.6, 0.3, 1.0]}, intensity: 0.8, cone_angle: 60}
      cast_shadows: true
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydrake.geometry import LightParameter, RenderEngineVtkParams

from physim_drake.errors import InputError
from physim_drake.picking.arm_planner import ArmPlanner
from physim_drake.picking.planner_config import PlanFailure
from physim_drake.picking.viewpoints import look_at
from physim_drake.poses import Array
from physim_drake.sensors.presets import CameraName

_TRIES = 8  # proposals for each view that is asked for
_ELEVATION = (0.7, 1.45)  # rad above the surface
_DISTANCE = (0.42, 0.7)  # m
_SHIFT = 0.04  # m, by which a view is off the middle

# Soft light from the camera's side, and more of it from above.
_ROOM = (
    {"frame": "camera", "direction": [0.0, 0.0, 1.0], "intensity": 0.5},
    {"frame": "world", "direction": [0.3, 0.4, -0.85], "intensity": 0.6},
)


def _room() -> RenderEngineVtkParams:
    params: Any = RenderEngineVtkParams()
    params.lights = [LightParameter(type="directional", **light) for light in _ROOM]
    params.default_clear_color = [0.3, 0.4, 0.45]
    return params  # type: ignore[no-any-return]


@dataclass(frozen=True)
class LookingConditions:
    """Under what conditions the robot looks.

    Attributes:
        camera: preset of the wrist camera.
        noise: whether its images err.
        renderer: lights and shadows, as Drake's `RenderEngineVtkParams` has them.
    """

    camera: CameraName = CameraName.D415
    noise: bool = True
    renderer: RenderEngineVtkParams = field(default_factory=_room)

    def __post_init__(self) -> None:
        if not self.renderer.lights:
            raise InputError(
                "renderer", "is empty", "give one light or more", "renderer.lights"
            )


def looking_postures(
    planner: ArmPlanner,
    p_WT: Array,
    views: int,
    rng: np.random.Generator,
    q_start: Array | None = None,
) -> Iterator[Array]:
    """Postures in which the wrist camera looks at a target from other sides each time.

    Each has a way to it from the one before that touches nothing the planner knows of;
    set what was seen before you ask for the next.

    Args:
        planner: the arm's planner.
        p_WT: what to look at, (3,), m.
        views: number of postures; fewer are given if the arm cannot take them.
        rng: random source of the viewpoints.
        q_start: current configuration of the arm, (n,); the home posture if it is None.

    Yields:
        joint angles, (n,).
    """
    q, found = planner.home if q_start is None else q_start, 0
    for _ in range(_TRIES * views):
        if found == views:
            return
        try:
            q = planner.plan_look(q, _draw_viewpoint(p_WT, rng)).end
        except PlanFailure:
            continue
        found += 1
        yield q


def _draw_viewpoint(p_WT: Array, rng: np.random.Generator) -> Array:
    """X_WC (4, 4) of a camera above a target."""
    azimuth, elevation = rng.uniform(-np.pi, np.pi), rng.uniform(*_ELEVATION)
    target = p_WT + np.array([*rng.uniform(-_SHIFT, _SHIFT, 2), 0.0])
    level = np.cos(elevation) * np.array([np.cos(azimuth), np.sin(azimuth)])
    offset = rng.uniform(*_DISTANCE) * np.array([*level, np.sin(elevation)])
    return look_at(target + offset, target)
