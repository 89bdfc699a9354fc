# SPDX-License-Identifier: MIT
"""The pick cell as one diagram: plant, drives, gripper, perception and task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.geometry import (
    Meshcat,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Role,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import (
    ModelDirectives,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import AddMultibodyPlant
from pydrake.multibody.tree import (
    JointActuatorIndex,
    ModelInstanceIndex,
    PdControllerGains,
)
from pydrake.systems.framework import Diagram, DiagramBuilder

from physim_drake.errors import InputError
from physim_drake.estimation.estimator import Method, PoseEstimator
from physim_drake.models import PACKAGE_XML
from physim_drake.observation.detector import DetectionAlgorithm
from physim_drake.picking.cell import PreparedCell, unusable_directives
from physim_drake.picking.initial_scene import PlacedModel
from physim_drake.picking.pick_choice import MotionPlanner
from physim_drake.picking.planning_plant import find_frame
from physim_drake.picking.policy import PickPolicy, TopOfPileFirst
from physim_drake.picking.scenario import DetectorName
from physim_drake.picking.table_detector import TableDetector
from physim_drake.picking.task import PickTask
from physim_drake.picking.trajectories import rest_trajectory
from physim_drake.suction.contact import add_cup_geometry
from physim_drake.systems.detector import (
    OracleDetector,
    TrainedDetector,
)
from physim_drake.systems.object_instances import (
    find_object_instances,
)
from physim_drake.systems.perception import AddPerceptionDiagram, PerceptionDiagram
from physim_drake.systems.perception_config import (
    EstimatorConfig,
    LatencyConfig,
    NetworkDetectorConfig,
    PerceptionCameraConfig,
    PerceptionConfig,
)
from physim_drake.systems.pick_task import JointLayout, PickTaskSystem
from physim_drake.systems.pose_visualizer import PoseVisualizerConfig
from physim_drake.systems.suction_gripper import SuctionGripper

_FRAME = 1 / 16  # s; replays are interpolated, and stay small


@dataclass(frozen=True)
class PickCellParts:
    """Parts that replace the usual ones; None for the usual one.

    Attributes:
        policy: choice of the next object and its suction point.
        detector: finds objects in images; by default what the scenario asks for.
        estimator: estimates their poses; whoever made it closes it.
        planner: plans the arm's motions.
        meshcat: shows everything.
    """

    policy: PickPolicy | None = None
    detector: DetectionAlgorithm | None = None
    estimator: PoseEstimator | None = None
    planner: MotionPlanner | None = None
    meshcat: Meshcat | None = None


class PickCell:
    """A pick cell, ready to simulate.

    The diagram has the systems `plant`, `scene_graph`, `suction_gripper`, `perception`,
    `pick_task` and, with Meshcat, `meshcat_visualizer`. The true poses of objects are
    on ports of `perception`, for whoever judges; nothing connects them to the task.

    Args:
        cell: the scenario, its objects and where things are.
        models: the objects of this episode.
        seed: seed of the camera's errors, the boxes and the search.
        parts: parts that replace the usual ones.

    Attributes:
        diagram: the whole diagram.
        plant: robot, cell and objects.
        perception: camera to estimate.
        task: the task's system.
        instances: the objects in the plant.
    """

    def __init__(
        self,
        cell: PreparedCell,
        models: Sequence[PlacedModel],
        seed: int = 0,
        parts: PickCellParts = PickCellParts(),
    ) -> None:
        self._cell, scenario = cell, cell.scenario
        builder = DiagramBuilder()
        self.plant, scene_graph = AddMultibodyPlant(scenario.plant_config, builder)
        scene_graph.set_config(scenario.scene_graph_config)
        robot = self._add_models(models)
        self._add_cup(scene_graph)
        self.plant.Finalize()
        self._set_rest(models)
        self.instances = find_object_instances(self.plant, cell.library, {})
        gripper = self._add_gripper(builder, scene_graph)
        self.perception = self._add_perception(builder, scene_graph, seed, parts)
        self.task = self._add_task(builder, robot, parts)
        for source, target in (
            (self.perception.GetOutputPort("scene_estimate"), "scene_estimate"),
            (gripper.vacuum_output_port(), "vacuum"),
        ):
            builder.Connect(source, self.task.GetInputPort(target))
        for name, port in (
            ("desired_state", self.plant.get_desired_state_input_port(robot)),
            ("vacuum_on", gripper.vacuum_on_input_port()),
            ("trigger", self.perception.GetInputPort("trigger")),
        ):
            builder.Connect(self.task.GetOutputPort(name), port)
        if parts.meshcat is not None:
            MeshcatVisualizer.AddToBuilder(
                builder,
                scene_graph,
                parts.meshcat,
                MeshcatVisualizerParams(publish_period=_FRAME),
            )
        self.diagram: Diagram = builder.Build()

    def close(self) -> None:
        """Ends worker processes, unless the estimator was given."""
        self.perception.close()

    def _add_models(self, models: Sequence[PlacedModel]) -> ModelInstanceIndex:
        """Adds everything to the plant and returns the robot's instance."""
        plant, config = self.plant, self._cell.scenario.planner
        parser = Parser(plant)
        parser.SetAutoRenaming(True)
        parser.package_map().AddPackageXml(PACKAGE_XML)
        directives = ModelDirectives(directives=list(self._cell.scenario.directives))
        try:
            ProcessModelDirectives(directives, parser)
        except RuntimeError as error:
            raise unusable_directives(error) from error
        for model in models:
            parser.AddModels(model.sdf)
        for name in config.robot_models:
            plant.set_gravity_enabled(plant.GetModelInstanceByName(name), False)
        drive = self._cell.scenario.drive
        gains = PdControllerGains(p=drive.stiffness, d=drive.damping)
        robot: ModelInstanceIndex = plant.GetJointByName(
            config.joints[0]
        ).model_instance()
        # Drake lists a model's actuators only after Finalize, when it is too late.
        for n in range(plant.num_actuators()):
            actuator = plant.get_joint_actuator(JointActuatorIndex(n))
            if actuator.model_instance() == robot:
                actuator.set_controller_gains(gains)
        return robot

    def _add_cup(self, scene_graph: SceneGraph) -> None:
        """Makes the cup touch as the gripper's model of it does.

        The shape in the robot's model is there for the planner, which knows nothing of
        a bellows' stroke.
        """
        plant = self.plant
        lip: Any = find_frame(plant, self._cell.scenario.planner.tool_frame)
        cup = lip.body()
        for geometry in plant.GetCollisionGeometriesForBody(cup):
            scene_graph.RemoveRole(plant.get_source_id(), geometry, Role.kProximity)
        X_BG = lip.GetFixedPoseInBodyFrame()
        add_cup_geometry(plant, cup, X_BG, self._cell.scenario.gripper)

    def _set_rest(self, models: Sequence[PlacedModel]) -> None:
        """Robot at home, objects where they begin."""
        plant, config = self.plant, self._cell.scenario.planner
        home = dict(zip(config.joints, config.home, strict=True))
        for name, angle in {**config.other_joints, **home}.items():
            plant.GetJointByName(name).set_default_positions([angle])
        for body, model in zip(self._object_bodies(len(models)), models, strict=True):
            plant.SetDefaultFloatingBaseBodyPose(body, RigidTransform(model.X_WO))

    def _object_bodies(self, count: int) -> list[Any]:
        """The bodies of the models that were added last."""
        plant = self.plant
        first = plant.num_model_instances() - count
        return [
            plant.get_body(plant.GetBodyIndices(ModelInstanceIndex(first + n))[0])
            for n in range(count)
        ]

    def _add_gripper(
        self, builder: DiagramBuilder, scene_graph: SceneGraph
    ) -> SuctionGripper:
        plant, robot = self.plant, set(self._cell.scenario.planner.robot_models)
        # Whatever the cup can touch, it can be sucked on to.
        touchable = [
            plant.get_body(index)
            for n in range(2, plant.num_model_instances())
            if plant.GetModelInstanceName(ModelInstanceIndex(n)) not in robot
            for index in plant.GetBodyIndices(ModelInstanceIndex(n))
            if plant.GetCollisionGeometriesForBody(plant.get_body(index))
        ]
        return SuctionGripper.AddToBuilder(
            builder,
            self._cell.scenario.gripper,
            plant,
            scene_graph,
            find_frame(plant, self._cell.scenario.planner.tool_frame),
            touchable,
        )

    def _add_perception(
        self,
        builder: DiagramBuilder,
        scene_graph: SceneGraph,
        seed: int,
        parts: PickCellParts,
    ) -> PerceptionDiagram:
        cell, look = self._cell, self._cell.scenario.look
        detector = (
            parts.detector
            or cell_network(cell)
            or OracleDetector(self.instances, look.box_jitter, look.min_pixels)
        )
        return AddPerceptionDiagram(
            builder,
            perception_config(cell, seed),
            scene_graph,
            plant=self.plant,
            library=cell.library,
            detector=TableDetector(detector, cell.geometry.tote),
            estimator=parts.estimator,
            meshcat=parts.meshcat,
        )

    def _add_task(
        self,
        builder: DiagramBuilder,
        robot: ModelInstanceIndex,
        parts: PickCellParts,
    ) -> PickTaskSystem:
        config, policy = self._cell.scenario.task, parts.policy
        geometry = self._cell.geometry
        planner = geometry.planner
        task = PickTask(
            config,
            parts.planner or planner,
            policy or TopOfPileFirst(min_confidence=config.min_confidence),
            policy or TopOfPileFirst(min_confidence=config.last_confidence),
            self._cell.library,
            geometry.conditions,
            geometry.views,
            geometry.tote,
        )
        rest = rest_trajectory(planner.scene, planner.home)
        system = PickTaskSystem(task, self._joint_layout(robot), rest)
        builder.AddNamedSystem("pick_task", system)
        return system

    def _joint_layout(self, robot: ModelInstanceIndex) -> JointLayout:
        plant, config = self.plant, self._cell.scenario.planner
        joints = [
            plant.get_joint_actuator(index).joint()
            for index in plant.GetJointActuatorIndices(robot)
        ]
        names = [joint.name() for joint in joints]
        missing = [name for name in config.joints if name not in names]
        if missing:
            raise InputError(
                "planner",
                f"{missing[0]} has no actuator",
                "give its joint one, with an effort limit above 0",
                "joints",
            )
        rest = np.array([joint.default_positions()[0] for joint in joints])
        return JointLayout(rest, [names.index(name) for name in config.joints])


def cell_network(cell: PreparedCell) -> TrainedDetector | None:
    """The network that a scenario asks for; None if it asks for the oracle.

    It may see each object of the library once, wherever it is, and is not told which of
    them an episode has.

    Raises:
        InputError: if its weights cannot be used, or are for other objects.
    """
    look, library = cell.scenario.look, cell.library
    if look.detector is DetectorName.ORACLE:
        return None
    config = NetworkDetectorConfig(
        look.weights,
        look.least_score,
        look.min_pixels,
        look.method is Method.FCN_PCA_ICP,
    )
    try:
        return config.make(library, dict.fromkeys(library, 1))
    except InputError as error:
        raise InputError(
            error.source,
            error.problem,
            f"{error.remedy}, or take the detector `oracle`",
            error.field,
        ) from error


def perception_config(cell: PreparedCell, seed: int) -> PerceptionConfig:
    """The cell's perception, as the perception diagram takes it.

    The support surface is the pick area.

    Args:
        cell: the prepared cell.
        seed: seed of all its random choices.
    """
    scenario, look = cell.scenario, cell.scenario.look
    return PerceptionConfig(
        camera=PerceptionCameraConfig.at_frame(
            scenario.planner.camera_frame, look.camera, look.noise, seed
        ),
        estimator=EstimatorConfig(
            method=look.method,
            expansions=look.expansions,
            representatives=look.representatives,
            workers=look.workers,
            seed=seed,
            surface_height=float(cell.geometry.X_WA[2, 3]),
            least_confidence=scenario.task.last_confidence,
        ),
        latency=LatencyConfig(estimator=look.latency),
        poll_period=scenario.task.period,
        library=scenario.objects.library,
        visualizer=PoseVisualizerConfig(cloud_stride=4, history=True),
    )
