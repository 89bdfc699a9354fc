# SPDX-License-Identifier: MIT
"""The ideal images of a plant that a `CameraSource` makes real ones of."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydrake.common.schema import Transform
from pydrake.geometry import (
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    LightParameter,
    MakeRenderEngineVtk,
    RenderEngineVtkParams,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import GetScopedFrameByName
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import RgbdSensor

from physim_drake.errors import InputError
from physim_drake.rendering.camera_core import NEAR, camera_core
from physim_drake.systems.perception_config import PerceptionCameraConfig

_FAR = 10.0  # m

# Soft light from the camera's side, and more of it from above.
_ROOM = (
    {"frame": "camera", "direction": [0.0, 0.0, 1.0], "intensity": 0.5},
    {"frame": "world", "direction": [0.3, 0.4, -0.85], "intensity": 0.6},
)
_LAMP_AT_CAMERA = ({"frame": "camera", "direction": [0.0, 0.0, 1.0]},)


def add_rgbd_sensors(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    config: PerceptionCameraConfig,
) -> tuple[RgbdSensor, RgbdSensor | None]:
    """Adds an RgbdSensor and, if reflections count, one that gives the echo image.

    Both render with VTK on EGL, which needs no display. Their body is the optical
    frame; that of the depth sensor is off by the camera's extrinsic error.

    Args:
        builder: gets the sensors.
        plant: what the camera stands in or is mounted on; finalized.
        scene_graph: gets the renderers that it has not.
        config: the camera.

    Raises:
        InputError: if the plant has no frame of the name in ``X_PB``.
    """
    mount = _mount(plant, config.X_PB)
    _add_renderer(scene_graph, config.renderer, _ROOM)
    K, seen = config.intrinsics, DepthRange(NEAR, _FAR)
    core = camera_core(K, config.renderer, _FAR)
    X_CD = RigidTransform(config.draw_extrinsic_error())
    depth = DepthRenderCamera(camera_core(K, config.renderer, _FAR, X_CD), seen)
    sensor = RgbdSensor(*mount, ColorRenderCamera(core), depth)
    builder.AddNamedSystem("rgbd_sensor", sensor)
    if not (config.depth_noise and config.reflections):
        return sensor, None
    projector = f"{config.renderer}_projector"
    _add_renderer(scene_graph, projector, _LAMP_AT_CAMERA)
    core = camera_core(K, projector, _FAR)
    echo_depth = DepthRenderCamera(core, seen)
    echo = RgbdSensor(*mount, ColorRenderCamera(core), echo_depth)
    builder.AddNamedSystem("projector_sensor", echo)
    return sensor, echo


def _mount(plant: MultibodyPlant, X_PB: Transform) -> tuple[Any, RigidTransform]:
    """The scene graph's frame of the body, and the camera's pose in it."""
    name = X_PB.base_frame or "world"
    try:
        frame = GetScopedFrameByName(plant, name)
    except RuntimeError as error:
        raise InputError(
            "camera",
            f"the plant has no frame {name!r}",
            "name one as in model::frame, or world",
            "X_PB.base_frame",
        ) from error
    X_BodyP = frame.GetFixedPoseInBodyFrame()
    frame_id = plant.GetBodyFrameIdOrThrow(frame.body().index())
    return frame_id, X_BodyP @ X_PB.GetDeterministicValue()


def _add_renderer(
    scene_graph: SceneGraph, name: str, lights: tuple[dict[str, Any], ...]
) -> None:
    if scene_graph.HasRenderer(name):
        return
    params: Any = RenderEngineVtkParams()
    params.backend = "EGL"
    params.lights = [LightParameter(type="directional", **light) for light in lights]
    params.default_clear_color = np.array([0.3, 0.4, 0.45])
    scene_graph.AddRenderer(name, MakeRenderEngineVtk(params))
