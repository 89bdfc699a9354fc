# SPDX-License-Identifier: MIT
"""Lets one object come to rest among objects that stay where they are.

Each free object has a small plant of its own. Every other object is welded to a frame
whose pose is a parameter of the context, so that placing it costs microseconds and
nothing is rebuilt. Contact is hydroelastic: the free object is compliant, the rest are
rigid.

The table is a half space on the world body. On a body of its own, welded to the world,
settling crashed now and then in the update of the broad phase (Drake 1.51; presumably
its unbounded box upsets the tree of moving geometry). No joint may be locked here,
since contact with world geometry would then crash as well.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    HalfSpace,
    ProximityProperties,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import (
    QuaternionFloatingJoint,
    RigidBody,
    SpatialInertia,
    UnitInertia,
    default_model_instance,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from physim_drake.objects.drake_shapes import collision_shapes
from physim_drake.objects.model import ObjectModel
from physim_drake.physics.slots import Slot, add_slot
from physim_drake.poses import Array, rotation_angle

_PARKED = RigidTransform([0.0, 0.0, -50.0])


@dataclass(frozen=True)
class SettleConfig:
    """When to stop, and how to integrate.

    Attributes:
        time_step: step of the discrete solver, s.
        max_time: simulated time after which settling ends, s.
        rest_speed: mean speed over `rest_steps` steps below which an object is at
            rest, m/s, or rad/s times its radius. It is measured between poses, not
            read from the velocity, because a body that rests may chatter.
        rest_steps: number of steps that `rest_speed` is measured over.
        lost_distance: distance from the start beyond which an object has lost its
            hold and is no longer followed, m.
        gravity: acceleration of gravity, m/s^2.
        hydroelastic_modulus: modulus of the free object, Pa.
        dissipation: Hunt-Crossley dissipation, s/m. Bodies separate no faster than its
            inverse, so that overlap does not throw them apart. The SAP approximation
            would ignore it.
        damping_time: time constant with which the free object's motion decays, s. The
            original system damps as heavily. The object then creeps to rest:
            penetration is pushed out without a jump, and nothing rolls off.
    """

    time_step: float = 0.01
    max_time: float = 0.8
    rest_speed: float = 0.01
    rest_steps: int = 4
    lost_distance: float = 0.3
    gravity: float = 9.81
    hydroelastic_modulus: float = 1e6
    dissipation: float = 50.0
    damping_time: float = 0.03


@dataclass(frozen=True)
class Settled:
    """Where an object came to rest.

    Attributes:
        X_SO: pose of the object, (4, 4).
        at_rest: whether it stopped within the time limit.
        lost: whether it lost its hold or the solver gave up. The pose is then
            meaningless.
        time: simulated time, s.
    """

    X_SO: Array
    at_rest: bool
    lost: bool
    time: float


class Settler:
    """Settles one object among fixed others on the plane z = 0 of frame S.

    Args:
        model: model of the object that moves.
        others: models of the objects that may be placed, in the order of the indices
            that `settle` takes.
        config: limits and constants of the simulation.
    """

    def __init__(
        self,
        model: ObjectModel,
        others: Sequence[ObjectModel],
        config: SettleConfig = SettleConfig(),
    ) -> None:
        self._config = config
        builder = DiagramBuilder()
        self._plant, _ = AddMultibodyPlant(
            MultibodyPlantConfig(
                time_step=config.time_step,
                discrete_contact_approximation="similar",
                contact_model="hydroelastic",
                use_sampled_output_ports=False,
            ),
            builder,
        )
        self._plant.mutable_gravity_field().set_gravity_vector(
            [0.0, 0.0, -config.gravity]
        )
        _add_table(self._plant)
        self._body: RigidBody = self._plant.AddRigidBody("free", _inertia(model))
        moment = float(np.trace(model.inertia)) / 3
        self._joint = self._plant.AddJoint(
            QuaternionFloatingJoint(
                "free",
                self._plant.world_frame(),
                self._body.body_frame(),
                angular_damping=moment / config.damping_time,
                translational_damping=model.mass / config.damping_time,
            )
        )
        _add_collision(self._plant, self._body, model, config)
        self._slots = [
            _add_placed(self._plant, f"placed_{n}", other)
            for n, other in enumerate(others)
        ]
        self._plant.Finalize()
        self._diagram = builder.Build()
        with _without_remark_on_half_spaces():
            self._simulator = Simulator(self._diagram)
        self._root = self._simulator.get_mutable_context()
        self._context = self._plant.GetMyMutableContextFromRoot(self._root)
        self._radius = model.diameter / 2

    def settle(self, X_SO: Array, placed: Mapping[int, Array]) -> Settled:
        """Drops the object from a pose and waits until it rests.

        Args:
            X_SO: pose at the start, (4, 4).
            placed: poses X_SO of the others that are in the scene, by index.
        """
        for n, slot in enumerate(self._slots):
            pose = RigidTransform(placed[n]) if n in placed else _PARKED
            slot.place(self._context, pose)
        self._joint.SetPose(self._context, RigidTransform(X_SO))
        self._plant.SetVelocities(self._context, np.zeros(6))
        self._root.SetTime(0.0)
        try:
            at_rest, lost = self._advance(X_SO[:3, 3])
        except RuntimeError:  # the contact solver did not converge
            return Settled(X_SO, at_rest=False, lost=True, time=self._root.get_time())
        return Settled(self._pose(), at_rest, lost, self._root.get_time())

    def _advance(self, start: Array) -> tuple[bool, bool]:
        """Steps until the body rests, is lost, or has no time left.

        A loop costs no more than a simulator's monitor, and runs neither Python nor
        its garbage collector in the middle of a step.

        Returns:
            whether the body rests, and whether it is lost.
        """
        config = self._config
        self._simulator.Initialize()
        duration = config.rest_steps * config.time_step
        last = self._pose()
        for n in range(1, math.ceil(config.max_time / duration) + 1):
            self._simulator.AdvanceTo(min(n * duration, config.max_time))
            pose = self._pose()
            # Written so that a pose that is not finite counts as lost.
            if not math.dist(pose[:3, 3], start) <= config.lost_distance:
                return False, True
            if self._travel(last, pose) < config.rest_speed * duration:
                return True, False
            last = pose
        return False, False

    def _pose(self) -> Array:
        pose = self._plant.EvalBodyPoseInWorld(self._context, self._body)
        return np.asarray(pose.GetAsMatrix4())

    def _travel(self, X: Array, Y: Array) -> float:
        """Distance between two poses: the larger of shift and turn at the rim, m."""
        turn = float(rotation_angle(X[:3, :3].T @ Y[:3, :3]))
        return max(math.dist(X[:3, 3], Y[:3, 3]), turn * self._radius)


@contextmanager
def _without_remark_on_half_spaces() -> Iterator[None]:
    """Mutes Drake's remark, in every context, that the table ignores soft bodies."""

    def wanted(record: logging.LogRecord) -> bool:
        return "half spaces are not" not in record.getMessage()

    logger = logging.getLogger("drake")
    logger.addFilter(wanted)
    try:
        yield
    finally:
        logger.removeFilter(wanted)


def _inertia(model: ObjectModel) -> SpatialInertia:
    com: Any = model.center_of_mass
    unit = UnitInertia(*_moments(model.inertia / model.mass))
    return SpatialInertia(model.mass, com, unit.ShiftFromCenterOfMass(com))


def _moments(inertia: Array) -> tuple[float, ...]:
    """Ixx, Iyy, Izz, Ixy, Ixz, Iyz of a (3, 3) matrix."""
    rows, columns = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)
    return tuple(float(inertia[r, c]) for r, c in zip(rows, columns, strict=True))


def _add_table(plant: MultibodyPlant) -> None:
    properties = ProximityProperties()
    AddContactMaterial(friction=CoulombFriction(0.8, 0.8), properties=properties)
    AddRigidHydroelasticProperties(properties)
    plant.RegisterCollisionGeometry(
        plant.world_body(), RigidTransform(), HalfSpace(), "plane", properties
    )


def _add_collision(
    plant: MultibodyPlant,
    body: RigidBody,
    model: ObjectModel,
    config: SettleConfig | None,
) -> None:
    """Registers the convex pieces, compliant with a config and rigid without."""
    properties = ProximityProperties()
    AddContactMaterial(
        friction=CoulombFriction(model.friction, model.friction),
        dissipation=config.dissipation if config else None,
        properties=properties,
    )
    if config:
        AddCompliantHydroelasticProperties(
            0.02, config.hydroelastic_modulus, properties
        )
    else:
        AddRigidHydroelasticProperties(0.02, properties)
    for n, shape in enumerate(collision_shapes(model)):
        plant.RegisterCollisionGeometry(
            body, RigidTransform(), shape, f"piece_{n}", properties
        )


def _add_placed(plant: MultibodyPlant, name: str, model: ObjectModel) -> Slot:
    world, instance = plant.world_frame(), default_model_instance()
    slot = add_slot(plant, name, instance, _inertia(model), world, _PARKED)
    _add_collision(plant, slot.body, model, None)
    return slot
