# SPDX-License-Identifier: MIT
"""The planner's own robot and cell, with room for estimated objects.

Nothing is simulated here. Each library object is there as often as the scene may hold
it, welded to frames whose poses are parameters of the context: `placed` copies in the
world, and one `held` copy at the cup. Setting a scene therefore takes microseconds;
copies that are not in use stay far away.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common import Parallelism
from pydrake.geometry import Convex, ProximityProperties
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import (
    LoadModelDirectives,
    ModelDirective,
    ModelDirectives,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    Frame,
    ModelInstanceIndex,
    RigidBody,
    SpatialInertia,
)
from pydrake.planning import (
    LinearDistanceAndInterpolationProvider,
    RobotDiagramBuilder,
    SceneGraphCollisionChecker,
)

from physim_drake.errors import InputError
from physim_drake.models import PACKAGE_XML
from physim_drake.objects.drake_shapes import collision_shapes
from physim_drake.objects.model import ObjectLibrary
from physim_drake.physics.slots import Slot, add_slot
from physim_drake.picking.planner_config import ArmPlannerConfig

PARKED = RigidTransform([0.0, 0.0, -100.0])
"""Of placed copies in the world."""

PARKED_HELD = RigidTransform([0.0, 0.0, -30.0])
"""Of held copies, behind the cup: clear of the parked ones whichever way it points."""

_MIN_LEVER = 0.25  # m; so that a wrist joint is not stepped by more than 2.3 degrees


@dataclass(frozen=True)
class PlanningPlant:
    """Robot, cell and slots.

    Attributes:
        plant: all of it.
        checker: tells whether the robot touches something.
        placed: copies in the world, by object id.
        held: the copy at the cup, by object id.
    """

    plant: MultibodyPlant
    checker: SceneGraphCollisionChecker
    placed: Mapping[int, tuple[Slot, ...]]
    held: Mapping[int, Slot]


def read_directives(*paths: Path) -> tuple[ModelDirective, ...]:
    """Reads model directives files, one after the other."""
    return tuple(d for p in paths for d in LoadModelDirectives(p).directives)


def build_planning_plant(
    directives: Sequence[ModelDirective],
    library: ObjectLibrary,
    config: ArmPlannerConfig,
    copies: Mapping[int, int],
) -> PlanningPlant:
    """Builds robot, cell and slots.

    Args:
        directives: robot, tools and everything that stands still in the cell.
        library: the objects.
        config: names in the directives.
        copies: number of placed copies of each object, by id; 0 if not named.

    Raises:
        InputError: if the directives lack a name of the configuration, or hold a
            body that can move by itself.
    """
    builder = RobotDiagramBuilder(time_step=0.0)
    plant, parser = builder.plant(), builder.parser()
    parser.package_map().AddPackageXml(str(PACKAGE_XML))
    ProcessModelDirectives(ModelDirectives(directives=list(directives)), parser)
    robot = [
        _look_up(plant, plant.GetModelInstanceByName, n) for n in config.robot_models
    ]
    tool = find_frame(plant, config.tool_frame)
    slots, hand = plant.AddModelInstance("placed"), plant.AddModelInstance("held")
    placed, held = {}, {}
    for object_id, model in library.items():
        shapes = collision_shapes(model)
        names = [f"placed_{object_id}_{n}" for n in range(copies.get(object_id, 0))]
        world = plant.world_frame()
        placed[object_id] = tuple(
            _add_copy(plant, name, slots, world, PARKED, shapes) for name in names
        )
        held[object_id] = _add_copy(
            plant, f"held_{object_id}", hand, tool, PARKED_HELD, shapes
        )
    plant.Finalize()
    _check_fixed(plant, config)
    levers: Any = {j: np.array([r]) for j, r in joint_levers(plant, robot).items()}
    make_checker: Any = SceneGraphCollisionChecker  # its stub lacks the constructor
    checker = make_checker(
        model=builder.Build(),
        robot_model_instances=[*robot, hand],
        distance_and_interpolation_provider=LinearDistanceAndInterpolationProvider(
            plant, levers
        ),
        edge_step_size=config.resolution,
        env_collision_padding=config.padding,
        self_collision_padding=config.self_padding,
        implicit_context_parallelism=Parallelism(1),
    )
    return PlanningPlant(plant, checker, placed, held)


def find_frame(plant: MultibodyPlant, name: str) -> Frame:
    """The frame called `model::frame`.

    Raises:
        InputError: if the plant does not have it.
    """
    frame: Frame = _look_up(plant, plant.GetFrameByName, name)
    return frame


def find_body(plant: MultibodyPlant, name: str) -> RigidBody:
    """The body called `model::body`.

    Raises:
        InputError: if the plant does not have it.
    """
    body: RigidBody = _look_up(plant, plant.GetBodyByName, name)
    return body


def joint_levers(
    plant: MultibodyPlant, robot: Iterable[ModelInstanceIndex]
) -> dict[Any, float]:
    """How far the farthest body origin behind each joint can be from its axis, m.

    The sum of the distances between successive joints outward, which no posture
    exceeds; so a joint's angle times its lever bounds the motion it causes.
    """
    context = plant.CreateDefaultContext()
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    inward = {joint.child_body().index(): joint for joint in joints}
    instances = set(robot)
    levers = {}
    for joint in joints:
        if joint.num_positions() != 1:
            continue
        behind = plant.GetBodiesKinematicallyAffectedBy([joint.index()])
        lengths = [
            _chain_length(context, inward, plant.get_body(body), joint)
            for body in behind
            if plant.get_body(body).model_instance() in instances
        ]
        levers[joint.index()] = max([_MIN_LEVER, *lengths])
    return levers


def _chain_length(
    context: Any, inward: Mapping[Any, Any], body: Any, joint: Any
) -> float:
    """Distance from a joint to a body behind it with the links between stretched."""
    length, tip = 0.0, body.body_frame()
    while True:
        link = inward[body.index()]
        base = link.frame_on_child()
        length += float(np.linalg.norm(tip.CalcPose(context, base).translation()))
        if link.index() == joint.index():
            return length
        tip, body = link.frame_on_parent(), link.parent_body()


def _add_copy(
    plant: MultibodyPlant,
    name: str,
    instance: ModelInstanceIndex,
    parent: Frame,
    X_parked: RigidTransform,
    shapes: Sequence[Convex],
) -> Slot:
    inertia = SpatialInertia.SolidSphereWithMass(1.0, 0.1)  # nothing moves by it
    slot = add_slot(plant, name, instance, inertia, parent, X_parked)
    for n, shape in enumerate(shapes):
        plant.RegisterCollisionGeometry(
            slot.body, RigidTransform(), shape, f"piece_{n}", ProximityProperties()
        )
    return slot


def _look_up(plant: MultibodyPlant, get: Any, name: str) -> Any:
    model, _, element = name.rpartition("::")
    try:
        return (
            get(element, plant.GetModelInstanceByName(model)) if model else get(element)
        )
    except RuntimeError as error:
        raise InputError(
            "cell directives",
            f"nothing is called {name!r}: {str(error).splitlines()[0][:200]}",
            "correct the name in the planner's configuration, or the directives",
        ) from error


def _check_fixed(plant: MultibodyPlant, config: ArmPlannerConfig) -> None:
    """Refuses a cell with free bodies, and joints that it does not have."""
    for index in plant.GetFloatingBaseBodies():
        raise InputError(
            "cell directives",
            f"the body {plant.get_body(index).scoped_name()} is free to move",
            "weld it, or leave it out: the planner takes objects from the estimate",
        )
    for name in (*config.joints, *config.other_joints, *config.limits):
        _look_up(plant, plant.GetJointByName, name)
