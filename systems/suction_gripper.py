# SPDX-License-Identifier: MIT
"""A vacuum gripper: a valve in, forces on cup and object and a vacuum sensor out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    ContactModel,
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
)
from pydrake.multibody.tree import BodyIndex, Frame, RigidBody
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    EventStatus,
    InputPort,
    LeafSystem,
    OutputPort,
)

from physim_drake.errors import InputError
from physim_drake.poses import Array
from physim_drake.suction.contact import read_surface, require_hydroelastic
from physim_drake.suction.cup import SuctionConfig, Surface, find_seal, step_vacuum

_LEVEL, _HELD, _NORMAL, _GAP = 0, 1, slice(2, 5), 5  # of the discrete state
_NOTHING = -1.0
_EMPTY: Any = np.array([0.0, _NOTHING, 0.0, 0.0, 0.0, 0.0])


class SuctionGripper(LeafSystem):
    """Pulls cup and object together with the vacuum's force. Contact does the rest.

    .. pydrake_system::

        name: SuctionGripper
        input_ports:
        - vacuum_on
        - body_poses
        output_ports:
        - spatial_forces
        - vacuum
        - holding

    The valve is open while `vacuum_on` is above one half. `vacuum` is the level that a
    sensor in the hose reads, 0..1; `holding` is the vacuum switch's, 1 from
    `holding_level` up while the cup lies on an object. All state is discrete, so that
    a cloned context goes on as the original would.

    Args:
        config: the cup's.
        cup: index of the body that the cup is part of.
        X_BG: the lip's frame in that body.
        objects: the bodies that the cup may seal on.
        surfaces: surface of each of them, in its body frame.
    """

    def __init__(
        self,
        config: SuctionConfig,
        cup: BodyIndex,
        X_BG: RigidTransform,
        objects: Sequence[BodyIndex],
        surfaces: Sequence[Surface],
    ) -> None:
        LeafSystem.__init__(self)
        self._config, self._cup, self._X_BG = config, cup, X_BG
        self._objects, self._surfaces = tuple(objects), tuple(surfaces)
        self._vacuum_on = self.DeclareVectorInputPort("vacuum_on", 1)
        self._body_poses = self.DeclareAbstractInputPort(
            "body_poses", Value[list[RigidTransform]]()
        )
        state = self.DeclareDiscreteState(_EMPTY)
        state_ticket = self.discrete_state_ticket(state)
        self._spatial_forces = self.DeclareAbstractOutputPort(
            "spatial_forces",
            lambda: Value[list[ExternallyAppliedSpatialForce]](),
            self._calc_spatial_forces,
            prerequisites_of_calc={state_ticket, self._body_poses.ticket()},
        )
        self._vacuum = self.DeclareVectorOutputPort(
            "vacuum", 1, self._calc_vacuum, prerequisites_of_calc={state_ticket}
        )
        self._holding = self.DeclareVectorOutputPort(
            "holding", 1, self._calc_holding, prerequisites_of_calc={state_ticket}
        )
        self.DeclarePeriodicDiscreteUpdateEvent(config.period, 0.0, self._update)

    def vacuum_on_input_port(self) -> InputPort:
        """The valve: open above one half."""
        return self._vacuum_on

    def body_poses_input_port(self) -> InputPort:
        """The plant's `body_poses`."""
        return self._body_poses

    def spatial_forces_output_port(self) -> OutputPort:
        """For the plant's `applied_spatial_force`."""
        return self._spatial_forces

    def vacuum_output_port(self) -> OutputPort:
        """The vacuum sensor, 0..1."""
        return self._vacuum

    def holding_output_port(self) -> OutputPort:
        """The vacuum switch, 0 or 1."""
        return self._holding

    def _update(self, context: Context, discrete_state: Any) -> EventStatus:
        state = _state(context)
        valve: Any = self._vacuum_on.Eval(context)
        pump_on = valve[0] > 0.5
        if not pump_on and state[_LEVEL] < 1e-4:
            if state[_LEVEL] == 0:
                return EventStatus.DidNothing()
            discrete_state.set_value(_EMPTY)
            return EventStatus.Succeeded()
        poses: Any = self._body_poses.Eval(context)
        seal = find_seal(
            (poses[self._cup] @ self._X_BG).GetAsMatrix4(),
            [poses[body].GetAsMatrix4() for body in self._objects],
            self._surfaces,
            self._config,
        )
        level = step_vacuum(
            state[_LEVEL], seal.leak, pump_on, self._config.period, self._config
        )
        held = _NOTHING if seal.index is None else seal.index
        discrete_state.set_value([level, held, *seal.normal, seal.gap])
        return EventStatus.Succeeded()

    def _calc_spatial_forces(self, context: Any, output: Any) -> None:
        state = _state(context)
        force = self._config.max_force * state[_LEVEL]
        if state[_HELD] == _NOTHING or force == 0:
            output.set_value([])
            return
        poses: Any = self._body_poses.Eval(context)
        body = self._objects[int(state[_HELD])]
        X_WB, X_WO = poses[self._cup], poses[body]
        p_BQ = self._X_BG @ np.array([0.0, 0.0, state[_GAP]])
        p_OQ = X_WO.inverse() @ (X_WB @ p_BQ)
        f_W = force * (X_WO.rotation() @ state[_NORMAL])
        output.set_value(
            [_force(body, p_OQ, f_W), _force(self._cup, p_BQ, -f_W)],
        )

    def _calc_vacuum(self, context: Any, output: Any) -> None:
        output.SetAtIndex(0, _state(context)[_LEVEL])

    def _calc_holding(self, context: Any, output: Any) -> None:
        state = _state(context)
        closed = state[_LEVEL] >= self._config.holding_level
        output.SetAtIndex(0, float(closed and state[_HELD] != _NOTHING))

    @staticmethod
    def AddToBuilder(
        builder: DiagramBuilder,
        config: SuctionConfig,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        cup_frame: Frame,
        objects: Sequence[RigidBody],
    ) -> SuctionGripper:
        """Adds a gripper and connects it to a plant.

        Args:
            builder: builder of the diagram that plant and scene graph are in.
            config: the cup's.
            plant: finalized, with hydroelastic contact; its `applied_spatial_force`
                is taken.
            scene_graph: where its geometry is registered.
            cup_frame: fixed on the cup's body at the lip's centre, z outward.
            objects: bodies that the cup may seal on, also a table or a wall, so that
                the sensor is fooled as a real one is.

        Returns:
            the gripper; its `vacuum_on` is left to connect.

        Raises:
            InputError: if contact would not hold what the vacuum pulls.
        """
        frame: Any = cup_frame  # whose methods have no types
        cup = frame.body()
        _check_contact(plant, scene_graph, cup, objects)
        inspector = scene_graph.model_inspector()
        gripper = SuctionGripper(
            config,
            cup.index(),
            frame.GetFixedPoseInBodyFrame(),
            [body.index() for body in objects],
            [
                read_surface(
                    inspector, plant.GetCollisionGeometriesForBody(body), body.name()
                )
                for body in objects
            ],
        )
        builder.AddNamedSystem("suction_gripper", gripper)
        builder.Connect(
            plant.GetOutputPort("body_poses"), gripper.body_poses_input_port()
        )
        builder.Connect(
            gripper.spatial_forces_output_port(),
            plant.GetInputPort("applied_spatial_force"),
        )
        return gripper


def _check_contact(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    cup: RigidBody,
    objects: Sequence[RigidBody],
) -> None:
    """Refuses contact that would not hold what the vacuum pulls."""
    if plant.get_contact_model() == ContactModel.kPoint:
        raise InputError(
            "plant",
            "a cup needs a patch of contact, and point contact has none",
            "set contact_model to hydroelastic_with_fallback",
            "contact_model",
        )
    default = scene_graph.get_config().default_proximity_properties.compliance_type
    if default == "undefined":  # or else what has no type of its own gets one later
        inspector = scene_graph.model_inspector()
        require_hydroelastic(plant, inspector, cup, soft=True)
        for body in objects:
            require_hydroelastic(plant, inspector, body, soft=False)


def _state(context: Context) -> Array:
    value: Any = context.get_discrete_state(0).value()
    return np.asarray(value)


def _force(body: BodyIndex, p_BoBq_B: Any, f_W: Any) -> ExternallyAppliedSpatialForce:
    """A force without a moment on a point of a body."""
    force = ExternallyAppliedSpatialForce()
    force.body_index, force.p_BoBq_B = body, p_BoBq_B
    no_moment: Any = np.zeros(3)
    force.F_Bq_W = SpatialForce(no_moment, f_W)
    return force
