# SPDX-License-Identifier: MIT
"""A gantry with a vacuum cup above a table: slides along z and x, and a wrist."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    ProximityProperties,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialForce, SpatialVelocity
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import (
    PdControllerGains,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    SpatialInertia,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem

from physim_drake.poses import Array
from physim_drake.suction.contact import add_cup_geometry
from physim_drake.suction.cup import SuctionConfig
from physim_drake.systems.suction_gripper import SuctionGripper

WRIST_TO_LIP = 0.1
_DRIVES = {"x": (4e4, 2e3), "z": (4e4, 2e3), "wrist": (4e3, 2e2)}
_DOWN = RotationMatrix.MakeXRotation(np.pi)


def contact(modulus: float | None = 1e7, friction: float = 0.8) -> ProximityProperties:
    """Compliant, or rigid for a modulus of None."""
    properties = ProximityProperties()
    AddContactMaterial(
        friction=CoulombFriction(friction, friction), properties=properties
    )
    if modulus is None:
        AddRigidHydroelasticProperties(0.01, properties)
    else:
        AddCompliantHydroelasticProperties(0.01, modulus, properties)
    return properties


class _Push(LeafSystem):
    """Adds a force on one body's origin to the forces of others."""

    def __init__(self, body: RigidBody) -> None:
        LeafSystem.__init__(self)
        self._body = body.index()
        allocate = Value[list[ExternallyAppliedSpatialForce]]
        self.forces = self.DeclareAbstractInputPort("forces", allocate())
        self.wrench = self.DeclareVectorInputPort("wrench", 6)
        self.DeclareAbstractOutputPort("sum", allocate, self._calc)

    def _calc(self, context: Context, output: Any) -> None:
        push = ExternallyAppliedSpatialForce()
        wrench = self.wrench.Eval(context)
        push.body_index, push.p_BoBq_B = self._body, np.zeros(3)
        push.F_Bq_W = SpatialForce(tau=wrench[:3], f=wrench[3:])
        output.set_value([*self.forces.Eval(context), push])


class Gantry:
    """A cup that hangs from a gantry, above objects on a table whose top is z = 0.

    Args:
        objects: shape and mass of each.
        config: the cup's.
        time_step: of the plant, s.
        approximation: of contact.
        wall: x of a fixed wall's face that looks towards -x, m.
        tool: model of a gripper with a frame `cup`, instead of a bare cup.
    """

    def __init__(
        self,
        objects: Sequence[tuple[Any, float]],
        config: SuctionConfig | None = None,
        *,
        time_step: float = 0.005,
        approximation: str = "lagged",
        wall: float | None = None,
        tool: Path | None = None,
    ) -> None:
        config = config or SuctionConfig()
        builder = DiagramBuilder()
        self.plant, scene_graph = AddMultibodyPlant(
            MultibodyPlantConfig(
                time_step=time_step, discrete_contact_approximation=approximation
            ),
            builder,
        )
        self.table = self._add_fixed("table", Box(2.0, 2.0, 0.1), [0, 0, -0.05])
        if wall is not None:
            self._add_fixed("wall", Box(0.1, 2.0, 2.0), [wall + 0.05, 0, 1.0])
        cup_frame = self._add_tool(self._add_gantry(), config, tool)
        self.cup: RigidBody = cup_frame.body()
        self.objects = [
            self._add_object(f"object_{n}", shape, mass)
            for n, (shape, mass) in enumerate(objects)
        ]
        self.plant.Finalize()
        self.gripper = SuctionGripper.AddToBuilder(
            builder,
            config,
            self.plant,
            scene_graph,
            cup_frame,
            [*self.objects, self.table],
        )
        self._add_push(builder)
        builder.ExportInput(self.gripper.vacuum_on_input_port(), "vacuum_on")
        builder.ExportInput(
            self.plant.get_desired_state_input_port(self._instance), "desired_state"
        )
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.root: Context = self.simulator.get_mutable_context()
        self.context = self.plant.GetMyMutableContextFromRoot(self.root)
        self.switch(False)
        self.push()
        self.put_cup(0.0, 1.0)

    def _add_fixed(self, name: str, shape: Box, p: Sequence[float]) -> RigidBody:
        plant = self.plant
        body = plant.AddRigidBody(
            name,
            plant.AddModelInstance(name),
            SpatialInertia.SolidBoxWithMass(1, 1, 1, 1),
        )
        plant.WeldFrames(
            plant.world_frame(), body.body_frame(), RigidTransform(np.array(p))
        )
        plant.RegisterCollisionGeometry(
            body, RigidTransform(), shape, name, contact(None)
        )
        return body

    def _add_gantry(self) -> RigidBody:
        plant: MultibodyPlant = self.plant
        self._instance = plant.AddModelInstance("gantry")
        plant.set_gravity_enabled(self._instance, False)

        def link(name: str, mass: float) -> RigidBody:
            inertia = SpatialInertia.SolidBoxWithMass(mass, 0.1, 0.1, 0.1)
            return plant.AddRigidBody(name, self._instance, inertia)

        bridge, carriage, wrist = (
            link("bridge", 3),
            link("carriage", 3),
            link("hand", 2),
        )
        frames = [plant.world_frame(), bridge.body_frame(), carriage.body_frame()]
        joints = [
            PrismaticJoint("x", frames[0], bridge.body_frame(), [1, 0, 0]),
            PrismaticJoint("z", frames[1], carriage.body_frame(), [0, 0, 1]),
            RevoluteJoint("wrist", frames[2], wrist.body_frame(), [0, 1, 0]),
        ]
        for joint in joints:
            p, d = _DRIVES[joint.name()]
            actuator = plant.AddJointActuator(joint.name(), plant.AddJoint(joint))
            actuator.set_controller_gains(PdControllerGains(p=p, d=d))
        return wrist

    def _add_tool(
        self, hand: RigidBody, config: SuctionConfig, tool: Path | None
    ) -> Any:
        """Adds cup or gripper with its lip below the wrist. Returns the lip's frame."""
        plant, X_HG = self.plant, RigidTransform(_DOWN, [0, 0, -WRIST_TO_LIP])
        if tool is None:
            inertia = SpatialInertia.SolidCylinderWithMass(0.03, 0.015, 0.03, [0, 0, 1])
            cup = plant.AddRigidBody("cup", self._instance, inertia)
            plant.WeldFrames(hand.body_frame(), cup.body_frame(), X_HG)
            add_cup_geometry(plant, cup, RigidTransform(), config)
            return cup.body_frame()
        alone = MultibodyPlant(0.0)
        Parser(alone).AddModels(tool)
        alone.Finalize()
        mount, lip = alone.GetBodyByName("suction_gripper"), alone.GetFrameByName("cup")
        X_MG = lip.CalcPose(alone.CreateDefaultContext(), mount.body_frame())
        (instance,) = Parser(plant).AddModels(tool)
        plant.set_gravity_enabled(instance, False)
        mount = plant.GetBodyByName("suction_gripper", instance)
        plant.WeldFrames(hand.body_frame(), mount.body_frame(), X_HG @ X_MG.inverse())
        return plant.GetFrameByName("cup", instance)

    def _add_object(self, name: str, shape: Any, mass: float) -> RigidBody:
        body: RigidBody = self.plant.AddRigidBody(
            name, self.plant.AddModelInstance(name), _inertia(shape, mass)
        )
        self.plant.RegisterCollisionGeometry(
            body, RigidTransform(), shape, "shape", contact()
        )
        return body

    def _add_push(self, builder: DiagramBuilder) -> None:
        forces = self.gripper.spatial_forces_output_port()
        applied = self.plant.get_applied_spatial_force_input_port()
        builder.Disconnect(forces, applied)
        push = builder.AddSystem(_Push(self.objects[0]))
        builder.Connect(forces, push.forces)
        builder.Connect(push.get_output_port(), applied)
        builder.ExportInput(push.wrench, "push")

    def push(self, f_W: Sequence[float] = (0, 0, 0), *, tau_W: Any = (0, 0, 0)) -> None:
        """Loads the origin of object 0 with a force (N) and a torque (N m)."""
        self.diagram.GetInputPort("push").FixValue(self.root, [*tau_W, *f_W])

    def switch(self, on: bool) -> None:
        """Opens or closes the valve."""
        self.diagram.GetInputPort("vacuum_on").FixValue(self.root, [float(on)])

    def put(self, n: int, X_WO: RigidTransform) -> None:
        """Puts object `n` somewhere, at rest."""
        body = self.objects[n]
        self.plant.SetFloatingBaseBodyPoseInWorldFrame(self.context, body, X_WO)
        self.plant.SetFreeBodySpatialVelocity(
            self.context, body, SpatialVelocity.Zero()
        )

    def put_cup(self, x: float, z: float, turn: float = 0.0) -> None:
        """Puts the lip's centre at (x, 0, z), at rest, turned about y."""
        self.target = self._joints(x, z, turn)
        self.plant.SetPositions(self.context, self._instance, self.target)
        self.plant.SetVelocities(self.context, self._instance, np.zeros(3))
        self._drive(self.target, np.zeros(3))

    def move(self, x: float, z: float, turn: float = 0.0, *, time: float) -> None:
        """Drives the lip's centre to (x, 0, z), with no jerk at the ends."""
        begin, end = self.target, self._joints(x, z, turn)
        start, steps = self.root.get_time(), max(1, round(time / 0.005))
        for n in range(1, steps + 1):
            s = n / steps
            way = s**3 * (10 + s * (6 * s - 15))
            speed = 30 * s**2 * (1 - s) ** 2 / time
            self._drive(begin + way * (end - begin), speed * (end - begin))
            self.simulator.AdvanceTo(start + s * time)
        self.target = end

    def wait(self, time: float) -> None:
        """Lets time pass."""
        self.simulator.AdvanceTo(self.root.get_time() + time)

    def _joints(self, x: float, z: float, turn: float) -> Array:
        return np.array(
            [x + WRIST_TO_LIP * np.sin(turn), z + WRIST_TO_LIP * np.cos(turn), turn]
        )

    def _drive(self, q: Array, v: Array) -> None:
        port = self.diagram.GetInputPort("desired_state")
        port.FixValue(self.root, np.concatenate([q, v]))

    def read(self, port: str) -> float:
        """Value of one of the gripper's outputs."""
        context = self.gripper.GetMyContextFromRoot(self.root)
        value: float = self.gripper.GetOutputPort(port).Eval(context)[0]
        return value

    def X_WO(self, n: int = 0) -> RigidTransform:
        """Pose of object `n`."""
        return self.objects[n].EvalPoseInWorld(self.context)

    def speed(self, n: int = 0) -> float:
        """Norm of object `n`'s spatial velocity, rad/s and m/s."""
        velocity = self.objects[n].EvalSpatialVelocityInWorld(self.context)
        return float(np.linalg.norm(velocity.get_coeffs()))

    def X_GO(self, n: int = 0) -> RigidTransform:
        """Pose of object `n` in the cup."""
        return self.cup.EvalPoseInWorld(self.context).inverse() @ self.X_WO(n)


def _inertia(shape: Any, mass: float) -> SpatialInertia:
    if isinstance(shape, Box):
        return SpatialInertia.SolidBoxWithMass(mass, *shape.size())
    if hasattr(shape, "length"):
        return SpatialInertia.SolidCylinderWithMass(
            mass, shape.radius(), shape.length(), [0, 0, 1]
        )
    return SpatialInertia.SolidSphereWithMass(mass, shape.radius())
