# SPDX-License-Identifier: MIT
"""All objects of a scene as free bodies of one MultibodyPlant.

It gives the distances of bodies, which placement uses, and lets the scene come to rest.
Contact is hydroelastic: objects are compliant, the container is rigid and belongs to a
body welded to the world (geometry on the world body itself can crash Drake 1.51).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.geometry import SceneGraphConfig
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import QuaternionFloatingJoint
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from physim_drake.objects.containers import Container
from physim_drake.objects.model import ObjectModel
from physim_drake.poses import Array, inverse, make_pose, rotation_angle
from physim_drake.scenes.config import SettlingConfig
from physim_drake.scenes.contact_graph import Pair

CONTAINER = -1
"""Index of the container in pairs of bodies."""

_CHECK_INTERVAL = 0.05  # s
_RELAXATION_TIME = 0.02  # s
_QUIET_CHECKS = 2  # one could be the turning point of a swing


@dataclass(frozen=True)
class RestingScene:
    """Poses and distances of the objects of a scene at rest.

    Attributes:
        X_WO: poses of the objects, (N, 4, 4), m.
        distances: distance of each pair of bodies that are near each other, m;
            negative if they penetrate; `CONTAINER` stands for the container.
        time: simulated time until they rested, s.
    """

    X_WO: Array
    distances: dict[Pair, float]
    time: float


class NotAtRestError(Exception):
    """A scene did not come to rest within its limits, for the reason in the message."""


class ScenePlant:
    """The objects of one scene and their container; objects are parked at first.

    Args:
        objects: models of the objects.
        model_files: SDF files of the models, as `write_drake_model` writes them.
        container: support of the objects.
        config: settings of the settling.
    """

    def __init__(
        self,
        objects: Sequence[ObjectModel],
        model_files: Sequence[Path],
        container: Container,
        config: SettlingConfig,
    ) -> None:
        self.objects, self._config = tuple(objects), config
        builder = DiagramBuilder()
        plant, scene_graph = _empty_plant(builder, config)
        self._plant, self._graph = plant, scene_graph
        parser = Parser(plant)
        parser.SetAutoRenaming(True)  # an object may occur twice
        (instance,) = parser.AddModels(container.sdf)
        plant.WeldFrames(
            plant.world_frame(), plant.GetBodyByName("body", instance).body_frame()
        )
        instances = [parser.AddModels(path)[0] for path in model_files]
        self._bodies = [plant.GetBodyByName("body", i) for i in instances]
        self._joints = [
            plant.AddJoint(
                QuaternionFloatingJoint(
                    f"free_{n}", plant.world_frame(), body.body_frame(), 0.0, 0.0
                )
            )
            for n, body in enumerate(self._bodies)
        ]
        plant.Finalize()
        table = plant.GetBodyByName("body", instance)
        self._index = {
            geometry: n
            for n, body in [(CONTAINER, table), *enumerate(self._bodies)]
            for geometry in plant.GetCollisionGeometriesForBody(body)
        }
        self._diagram = builder.Build()
        self._simulator = Simulator(self._diagram)
        self._root = self._simulator.get_mutable_context()
        self._context = plant.GetMyMutableContextFromRoot(self._root)
        self._graph_context = scene_graph.GetMyContextFromRoot(self._root)
        for n in range(len(objects)):
            self.park(n)

    def park(self, n: int) -> None:
        """Puts object `n` far away from everything."""
        self.set_pose(n, make_pose(p=[10.0 * (n + 1), 0.0, -50.0]))

    def set_pose(self, n: int, X_WO: Array) -> None:
        """Puts object `n` at X_WO (4, 4)."""
        self._joints[n].SetPose(self._context, RigidTransform(X_WO))

    def poses(self) -> Array:
        """X_WO of all objects, (N, 4, 4)."""
        return np.stack(
            [
                self._plant.EvalBodyPoseInWorld(self._context, body).GetAsMatrix4()
                for body in self._bodies
            ]
        )

    def distances(self, max_distance: float) -> dict[Pair, float]:
        """Signed distances (m) of the pairs of bodies within `max_distance`."""
        query: Any = self._graph.get_query_output_port().Eval(self._graph_context)
        nearest: dict[Pair, float] = {}
        for pair in query.ComputeSignedDistancePairwiseClosestPoints(max_distance):
            a, b = self._index[pair.id_A], self._index[pair.id_B]
            key = (min(a, b), max(a, b))
            nearest[key] = min(nearest.get(key, np.inf), pair.distance)
        return nearest

    def clearance(self, n: int, others: Sequence[int], max_distance: float) -> float:
        """Distance (m) of object `n` to the nearest of `others`, if not farther."""
        near = self.distances(max_distance)
        pairs = [(min(n, other), max(n, other)) for other in others]
        return min([max_distance, *(near[pair] for pair in pairs if pair in near)])

    def settle(self) -> RestingScene:
        """Lets all objects move, damped, until they rest.

        Raises:
            NotAtRestError: if they do not rest in time, or penetrate.
        """
        config = self._config
        try:
            self._begin()
            self._damp(config.damping_time)
            quiet = 0
            while quiet < _QUIET_CHECKS:
                if self._root.get_time() > config.max_time:
                    raise NotAtRestError("still moves")
                self._advance(_CHECK_INTERVAL)
                quiet = quiet + 1 if self._is_still() else 0
        except RuntimeError as error:  # the contact solver did not converge
            raise NotAtRestError("the contact solver failed") from error
        return self._resting_scene()

    def hold(self) -> RestingScene:
        """Simulates a settled scene without damping, and checks that it stays.

        Raises:
            NotAtRestError: if an object moves again.
        """
        limits = self._config.limits
        start = self.poses()
        try:
            self._damp(np.inf)
            self._advance(self._config.hold_time)
        except RuntimeError as error:
            raise NotAtRestError("the contact solver failed") from error
        end = self.poses()
        motion = inverse(start) @ end
        shift = np.linalg.norm(end[:, :3, 3] - start[:, :3, 3], axis=1)
        if (
            not self._is_still()
            or shift.max() > limits.drift
            or rotation_angle(motion[:, :3, :3]).max() > limits.drift_angle
        ):
            raise NotAtRestError("moves again when left alone")
        return self._resting_scene()

    def _resting_scene(self) -> RestingScene:
        X_WO = self.poses()
        distances = self.distances(self._config.apart)
        if min(distances.values(), default=0.0) < -self._config.limits.penetration:
            raise NotAtRestError("objects penetrate")
        return RestingScene(X_WO, distances, self._root.get_time())

    def _begin(self) -> None:
        self._plant.SetVelocities(self._context, np.zeros(self._plant.num_velocities()))
        self._root.SetTime(0.0)
        self._simulator.Initialize()

    def _damp(self, time: float) -> None:
        """Makes the motion of every object die away with a time constant, s."""
        for joint, model in zip(self._joints, self.objects, strict=True):
            moment = float(np.trace(model.inertia)) / 3
            damping = np.repeat([moment / time, model.mass / time], 3)
            joint.SetDampingVector(self._context, damping)

    def _advance(self, time: float) -> None:
        self._simulator.AdvanceTo(self._root.get_time() + time)

    def _is_still(self) -> bool:
        limits = self._config.limits
        for body, model in zip(self._bodies, self.objects, strict=True):
            V_WO = self._plant.EvalBodySpatialVelocityInWorld(self._context, body)
            v, w = V_WO.translational(), V_WO.rotational()
            R_WO = self._plant.EvalBodyPoseInWorld(self._context, body).rotation()
            v_com = v + np.cross(w, R_WO.multiply(model.center_of_mass))
            speed = max(float(np.linalg.norm(v)), float(np.linalg.norm(v_com)))
            if not speed < limits.speed or not np.linalg.norm(w) < limits.angular_speed:
                return False
        return True


def _empty_plant(builder: DiagramBuilder, config: SettlingConfig) -> tuple[Any, Any]:
    """A plant with hydroelastic contact that pushes out overlap; its scene graph."""
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=config.time_step,
            discrete_contact_approximation="sap",
            contact_model="hydroelastic",
            use_sampled_output_ports=False,
        ),
        builder,
    )
    # Overlap is pushed out with this time constant; Drake's 0.1 s creeps.
    defaults = SceneGraphConfig()
    defaults.default_proximity_properties.relaxation_time = _RELAXATION_TIME
    scene_graph.set_config(defaults)
    return plant, scene_graph
