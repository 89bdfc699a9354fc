# SPDX-License-Identifier: MIT
"""The estimated scene as the arm's planner sees it: where the robot would touch what.

A configuration `q` holds the planned joints only, in the order of the configuration;
the robot's other joints stay where they are.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import ModelDirective
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Frame, JacobianWrtVariable

from physim_drake.errors import InputError
from physim_drake.objects.model import ObjectLibrary
from physim_drake.physics.slots import Slot
from physim_drake.picking.planner_config import ArmPlannerConfig, HeldObject
from physim_drake.picking.planning_plant import (
    PARKED,
    PARKED_HELD,
    build_planning_plant,
    find_body,
    find_frame,
)
from physim_drake.picking.surroundings import PlacedObject
from physim_drake.poses import Array

_TOUCHABLE = -0.05
"""m that the cup may be pressed into its target; no pose error exceeds it."""

_SLACK = 0.001
"""m that a pair which is too near at the start may come nearer."""


class PlanningScene:
    """Robot, cell and estimated objects, for questions of geometry.

    Args:
        directives: robot, tools and everything that stands still in the cell.
        library: the objects that may be set.
        config: names in the directives, and distances.

    Attributes:
        tool_frame: frame of the cup.
        camera_frame: frame of the camera.
        columns: indices of the planned joints among the plant's positions, (n,).
        lower: lower limits of the planned joints, with their margin, (n,), rad.
        upper: upper limits, (n,), rad.
        weights: motion of the robot's farthest part with each joint, (n,), m/rad.

    Raises:
        InputError: if the directives lack a name of the configuration.
    """

    def __init__(
        self,
        directives: Sequence[ModelDirective],
        library: ObjectLibrary,
        config: ArmPlannerConfig,
    ) -> None:
        self.config, self.library = config, library
        self._directives = tuple(directives)
        self._other_joints = dict(config.other_joints)
        self._objects: tuple[PlacedObject, ...] = ()
        self._held: HeldObject | None = None
        self._build(dict.fromkeys(library, 1))

    def _build(self, copies: Mapping[int, int]) -> None:
        self._built = build_planning_plant(
            self._directives, self.library, self.config, copies
        )
        plant = self.plant
        self.tool_frame = find_frame(plant, self.config.tool_frame)
        self.camera_frame = find_frame(plant, self.config.camera_frame)
        joints = [plant.GetJointByName(name) for name in self.config.joints]
        self.columns = np.array([joint.position_start() for joint in joints])
        self.lower, self.upper = self._limits(joints)
        levers = self.checker.distance_and_interpolation_provider().distance_weights()
        self.weights = np.array(levers)[self.columns]
        self._context = plant.CreateDefaultContext()
        self._roles = _Roles(plant, self.config, self._built.held)
        self._strict = self._roles.paddings(self.checker.GetPaddingMatrix())
        self._slot_of: dict[int, Slot] = {}
        self._set_full(self.config.other_joints)

    @property
    def plant(self) -> Any:
        """Drake's `MultibodyPlant` of robot, cell and slots."""
        return self._built.plant

    @property
    def checker(self) -> Any:
        """Drake's `SceneGraphCollisionChecker` on the plant."""
        return self._built.checker

    @property
    def objects(self) -> tuple[PlacedObject, ...]:
        """The objects that were set."""
        return self._objects

    @property
    def held(self) -> HeldObject | None:
        """The object at the cup."""
        return self._held

    def set_objects(self, placed: Sequence[PlacedObject]) -> None:
        """Puts the estimated objects where they are, and no others.

        If there are more copies of an object than ever before, the plant is built
        again, in a quarter of a second.
        """
        needed = Counter(item.model.object_id for item in placed)
        have = {i: len(slots) for i, slots in self._built.placed.items()}
        for object_id in needed:
            if object_id not in have:
                self.library[object_id]  # raises, naming what there is
        if any(count > have[i] for i, count in needed.items()):
            self._build({i: max(have[i], needed[i]) for i in have})
        self._objects = tuple(placed)
        self._hold(None)

    @contextmanager
    def state(
        self,
        *,
        held: HeldObject | None = None,
        touch: int | None = None,
        start: Array | None = None,
    ) -> Iterator[None]:
        """Sets what the cup holds and which distances count as free, for a while.

        At the end everything is as it was before. In nested states the inner one
        counts alone. Do not call `set_objects` within.

        Args:
            held: the object at the cup; it is no longer where it was seen.
            touch: index of the object that the cup may touch.
            start: a configuration (n,) that must count as free; each pair of bodies
                that is too near there may stay as near as it is. Contacts of a held
                object with what it rested on, and errors of the estimate, would
                otherwise forbid every motion.
        """
        before, paddings = self._held, self.checker.GetPaddingMatrix().copy()
        try:
            self._hold(held)
            self._keep_distances(touch, start)
            yield
        finally:
            self._hold(before)
            self.checker.SetPaddingMatrix(paddings)

    def is_free(self, q: Array) -> bool:
        """Whether the robot keeps its distances at `q`, (n,)."""
        return bool(self.checker.CheckConfigCollisionFree(self.full(q)))

    def edge_free(self, q_a: Array, q_b: Array) -> bool:
        """Whether it does on the straight line from `q_a` to `q_b`."""
        return bool(self.checker.CheckEdgeCollisionFree(self.full(q_a), self.full(q_b)))

    def path_free(self, path: Array) -> bool:
        """Whether it does along a polyline (N, n)."""
        return all(self.edge_free(a, b) for a, b in pairwise(path))

    def conflicts(self, q: Array) -> str:
        """What is too near to what at `q`, in words, or an empty text."""
        names = [
            f"{self._name(a)} and {self._name(b)} ({1000 * d:.0f} mm)"
            for a, b, d in sorted(self._near_pairs(q), key=lambda pair: pair[2])
        ]
        return ", ".join(names[:2])

    def distance(self, q_a: Array, q_b: Array) -> float:
        """How far the robot moves between two configurations, about, m."""
        return float(np.linalg.norm(self.weights * (q_b - q_a)))

    def full(self, q: Array) -> Array:
        """All positions of the plant, for the planned ones `q`, (n,) or (N, n)."""
        full = np.empty((*np.shape(q)[:-1], len(self._rest)))
        full[...] = self._rest
        full[..., self.columns] = q
        return full

    def part(self, full: Array) -> Array:
        """The planned joints of positions of the whole plant, (..., n)."""
        return np.asarray(full[..., self.columns])

    def pose(self, frame: Frame, q: Array) -> Array:
        """X_WF (4, 4) of a frame of the robot."""
        self.plant.SetPositions(self._context, self.full(q))
        return np.asarray(frame.CalcPoseInWorld(self._context).GetAsMatrix4())

    def tool_pose(self, q: Array) -> Array:
        """X_WG of the cup, (4, 4)."""
        return self.pose(self.tool_frame, q)

    def camera_pose(self, q: Array) -> Array:
        """X_WC of the camera, (4, 4)."""
        return self.pose(self.camera_frame, q)

    def jacobian(self, frame: Frame, q: Array) -> Array:
        """Of a frame's angular and translational velocity in W, (6, n)."""
        self.plant.SetPositions(self._context, self.full(q))
        world = self.plant.world_frame()
        J = self.plant.CalcJacobianSpatialVelocity(
            self._context,
            JacobianWrtVariable.kV,
            frame,
            np.zeros(3),
            world,
            world,
        )
        return np.asarray(J[:, self.columns])

    def within_limits(self, q: Array, slack: float = 0.0) -> bool:
        """Whether configurations (..., n) keep the joints' limits, to `slack` rad."""
        return bool(((q >= self.lower - slack) & (q <= self.upper + slack)).all())

    def set_other_joints(self, angles: Mapping[str, float]) -> None:
        """Sets the angles of joints that are not planned, rad by name.

        Raises:
            InputError: if a joint is planned.
        """
        self._set_full(angles)

    def _hold(self, held: HeldObject | None) -> None:
        """Attaches an object, or nothing, to the cup and puts the others where seen."""
        self._held = held
        gone = None if held is None else held.index
        poses: list[tuple[Slot, RigidTransform]] = []
        free = {i: list(slots) for i, slots in self._built.placed.items()}
        self._slot_of = {}
        for item in self._objects:
            slot = free[item.model.object_id].pop(0)
            self._slot_of[item.index] = slot
            if item.index != gone:
                poses.append((slot, RigidTransform(item.X_WO)))
            else:
                poses.append((slot, PARKED))
        poses += [(slot, PARKED) for slots in free.values() for slot in slots]
        for object_id, slot in self._built.held.items():
            here = held is not None and held.object_id == object_id
            X = RigidTransform(held.X_GO) if held and here else PARKED_HELD
            poses.append((slot, X))

        def place(_: Any, context: Any) -> None:
            for slot, X in poses:
                slot.frame.SetPoseInParentFrame(context.plant_context(), X)

        self.checker.PerformOperationAgainstAllModelContexts(place)
        self._keep_distances()

    def _keep_distances(
        self, touch: int | None = None, start: Array | None = None
    ) -> None:
        """Sets which distances count as free; see `state`."""
        paddings = self._strict.copy()
        if touch is not None:
            body = int(self._slot_of[touch].body.index())
            cup = self._roles.cup
            paddings[cup, body] = paddings[body, cup] = _TOUCHABLE
        self.checker.SetPaddingMatrix(paddings)
        if start is None:
            return
        near = self._near_pairs(start)
        if not near:
            return
        for a, b, distance in near:
            paddings[a, b] = paddings[b, a] = min(paddings[a, b], distance - _SLACK)
        self.checker.SetPaddingMatrix(paddings)

    def _set_full(self, angles: Mapping[str, float]) -> None:
        for name in angles:
            if name in self.config.joints:
                raise InputError(
                    "ArmPlannerConfig",
                    f"{name} is planned",
                    "leave it out, or take it from `joints`",
                    "other_joints",
                )
        self._other_joints |= angles
        self._rest = np.zeros(self.plant.num_positions())
        for name, angle in self._other_joints.items():
            joint = self.plant.GetJointByName(name)
            self._rest[joint.position_start()] = angle

    def _limits(self, joints: Sequence[Any]) -> tuple[Array, Array]:
        margin = self.config.limit_margin
        lower = np.array([j.position_lower_limits()[0] for j in joints]) + margin
        upper = np.array([j.position_upper_limits()[0] for j in joints]) - margin
        for n, name in enumerate(self.config.joints):
            low, high = self.config.limits.get(name, (lower[n], upper[n]))
            lower[n], upper[n] = max(lower[n], low), min(upper[n], high)
        return lower, upper

    def _near_pairs(self, q: Array) -> list[tuple[int, int, float]]:
        """Pairs of bodies that are nearer than they should be, with distance, m."""
        clearance = self.checker.CalcRobotClearance(self.full(q), 0.0)
        paddings = self.checker.GetPaddingMatrix()
        nearest: dict[tuple[int, int], float] = {}
        for a, b, excess in zip(
            clearance.robot_indices(),
            clearance.other_indices(),
            clearance.distances(),
            strict=True,
        ):
            key = (int(a), int(b))
            distance = float(excess) + float(paddings[key])
            if excess < 0:
                nearest[key] = min(nearest.get(key, np.inf), distance)
        return [(a, b, d) for (a, b), d in nearest.items()]

    def _name(self, body: int) -> str:
        for item in self._objects:
            if int(self._slot_of[item.index].body.index()) == body:
                return item.model.name
        for object_id, slot in self._built.held.items():
            if int(slot.body.index()) == body:
                return f"the held {self.library[object_id].name}"
        return str(self.plant.get_body(BodyIndex(body)).scoped_name())


class _Roles:
    """Which bodies are cup, slender tool, held or placed objects, by index."""

    def __init__(
        self, plant: MultibodyPlant, config: ArmPlannerConfig, held: Mapping[int, Slot]
    ) -> None:
        self.cup = int(find_body(plant, config.cup_body).index())
        self.slender = [
            self.cup,
            *(int(find_body(plant, name).index()) for name in config.tool_bodies),
            *(int(slot.body.index()) for slot in held.values()),
        ]
        self.padding = config.tool_padding
        robot = [
            plant.GetModelInstanceByName(name)
            for name in (*config.robot_models, "held")
        ]
        self.environment = [
            n
            for n in range(plant.num_bodies())
            if plant.get_body(BodyIndex(n)).model_instance() not in robot
        ]

    def paddings(self, nominal: Array) -> NDArray[np.float64]:
        """The matrix of distances to keep, (bodies, bodies)."""
        matrix = np.array(nominal)
        for body in self.slender:
            matrix[body, self.environment] = self.padding
            matrix[self.environment, body] = self.padding
        return matrix
