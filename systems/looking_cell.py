# SPDX-License-Identifier: MIT
"""The pick cell as a scene to look at: nothing moves but the wrist camera."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import MakeRenderEngineVtk, RenderEngineVtkParams
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import (
    ModelDirectives,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import DiagramBuilder

from physim_drake.models import PACKAGE_XML
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.detector import LabelImage
from physim_drake.observation.observation import RgbdObservation
from physim_drake.picking.cell import unusable_directives
from physim_drake.picking.initial_scene import PlacedModel
from physim_drake.picking.look_postures import LookingConditions
from physim_drake.picking.scenario import PickScenario
from physim_drake.poses import Array
from physim_drake.systems.camera_source import CameraSource
from physim_drake.systems.object_instances import find_object_instances
from physim_drake.systems.perception_config import PerceptionCameraConfig
from physim_drake.systems.rgbd_sensors import add_rgbd_sensors

_RENDERER = "conditions"
_PARKED = RigidTransform([0.0, 0.0, -50.0])


class LookingCell:
    """Takes images with the wrist camera, in any posture of the arm.

    The diagram has the cell's plant, with every object of the library in it, its scene
    graph, and the camera with its errors. Nothing moves in time: the arm is put where
    the planner would bring it, and objects are put where they came to rest.

    Args:
        scenario: the cell.
        library: the objects.
        files: Drake models of the objects, by id.
        conditions: lights and camera.
        seed: seed of the camera's errors.

    Attributes:
        instances: the objects in the plant; label images show their body's index.

    Raises:
        InputError: if a model or frame is missing.
    """

    def __init__(
        self,
        scenario: PickScenario,
        library: ObjectLibrary,
        files: Mapping[int, Path],
        conditions: LookingConditions,
        seed: int = 0,
    ) -> None:
        builder = DiagramBuilder()
        self._plant, graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
        parser = Parser(self._plant)
        parser.SetAutoRenaming(True)
        parser.package_map().AddPackageXml(PACKAGE_XML)
        try:
            ProcessModelDirectives(
                ModelDirectives(directives=list(scenario.directives)), parser
            )
        except RuntimeError as error:
            raise unusable_directives(error) from error
        for object_id in library:
            parser.AddModels(files[object_id])
        self._plant.Finalize()
        self.instances = find_object_instances(self._plant, library, {})
        graph.AddRenderer(_RENDERER, MakeRenderEngineVtk(_on_egl(conditions.renderer)))
        self._camera = self._add_camera(builder, graph, scenario, conditions, seed)
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._plant_context = self._plant.GetMyMutableContextFromRoot(self._context)
        self._joints = [
            self._plant.GetJointByName(name) for name in scenario.planner.joints
        ]
        for name, angle in scenario.planner.other_joints.items():
            self._set_angle(self._plant.GetJointByName(name), angle)
        self.place(())

    def place(self, models: Sequence[PlacedModel]) -> None:
        """Puts objects at their poses, and all others away."""
        poses = {model.object_id: model.X_WO for model in models}
        for instance in self.instances:
            X_WO = poses.get(instance.object_id)
            pose = _PARKED if X_WO is None else RigidTransform(X_WO)
            body = self._plant.get_body(BodyIndex(instance.body_index))
            self._plant.SetFreeBodyPose(self._plant_context, body, pose)

    def look(self, q: Array, number: int) -> tuple[RgbdObservation, LabelImage]:
        """Takes an image.

        Args:
            q: the arm's joint angles, (n,).
            number: number of the look; it decides the camera's errors.

        Returns:
            the image, whose X_WC comes from the arm's kinematics; and for judges the
            body index that each pixel truly shows, int16 (height, width).
        """
        for joint, angle in zip(self._joints, q, strict=True):
            self._set_angle(joint, float(angle))
        context = self._camera.GetMyContextFromRoot(self._context)
        observation, labels = self._camera.capture(context, number)
        return observation, labels

    def true_masks(
        self, labels: LabelImage, object_ids: Sequence[int]
    ) -> NDArray[np.bool_]:
        """The pixels that truly show each object, (N, height, width)."""
        bodies = {i.object_id: i.body_index for i in self.instances}
        wanted = np.array([bodies[i] for i in object_ids])
        return np.asarray(labels == wanted[:, None, None])

    def _add_camera(
        self,
        builder: DiagramBuilder,
        graph: Any,
        scenario: PickScenario,
        conditions: LookingConditions,
        seed: int,
    ) -> CameraSource:
        config = PerceptionCameraConfig.at_frame(
            scenario.planner.camera_frame,
            conditions.camera,
            conditions.noise,
            seed,
            _RENDERER,
        )
        sensor, echo = add_rgbd_sensors(builder, self._plant, graph, config)
        camera = CameraSource(config.intrinsics, config)
        builder.AddNamedSystem("camera", camera)
        query = graph.get_query_output_port()
        builder.Connect(query, sensor.query_object_input_port())
        for name in ("color_image", "depth_image_32f", "label_image"):
            builder.Connect(sensor.GetOutputPort(name), camera.GetInputPort(name))
        builder.Connect(
            sensor.body_pose_in_world_output_port(), camera.GetInputPort("X_WC")
        )
        if echo is not None:
            builder.Connect(query, echo.query_object_input_port())
            builder.Connect(
                echo.color_image_output_port(), camera.GetInputPort("echo_image")
            )
        return camera

    def _set_angle(self, joint: Any, angle: float) -> None:
        joint.set_angle(self._plant_context, angle)


def _on_egl(params: RenderEngineVtkParams) -> Any:
    """Rendering that needs no display, unless the parameters say otherwise."""
    changed: Any = copy.deepcopy(params)
    changed.backend = params.backend or "EGL"
    return changed
