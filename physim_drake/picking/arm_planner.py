# SPDX-License-Identifier: MIT
"""Plans the motions of a pick: look, reach, press, lift, carry.

    planner = ArmPlanner(read_directives(cell), library)
    planner.set_scene(estimate)
    pick = planner.plan_pick(q_now, candidate)
    carry = planner.plan_place(pick.retreat.end, X_WG_place, pick.held)

All against the estimated scene. The same calls give the same plans: each plan draws
its random numbers from the configured seed anew.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from pydrake.multibody.parsing import ModelDirective

from physim_drake.objects.model import ObjectLibrary
from physim_drake.picking.inverse_kinematics import IkSearch, PoseGoal
from physim_drake.picking.motions import connect, straight_line
from physim_drake.picking.planner_config import (
    ArmPlannerConfig,
    HeldObject,
    PlanFailure,
)
from physim_drake.picking.planning_scene import PlanningScene
from physim_drake.picking.policy import PickCandidate
from physim_drake.picking.surroundings import placed_objects
from physim_drake.picking.trajectories import (
    ArmTrajectory,
    Pace,
    line_trajectory,
    smooth_trajectory,
)
from physim_drake.picking.viewpoints import Viewpoint, propose_viewpoints
from physim_drake.poses import Array, inverse, transform_points
from physim_drake.scene_estimate import SceneEstimate

_LOOK_CONE = 0.09  # rad
_LOOK_RADIUS = 0.03  # m
_MAX_SEARCHES = 3  # for a way around obstacles, within one plan


@dataclass(frozen=True)
class PickPlan:
    """The motions of one pick, each from rest to rest.

    Attributes:
        candidate: what is picked, and where.
        transfer: motion to the pre-grasp.
        approach: motion along the cup's axis, to a little beyond contact.
        retreat: motion with the object, off what it lies on.
        X_WG: the cup's pose where the approach ends, (4, 4).
        held: the object at the cup, as it should be from there on.
    """

    candidate: PickCandidate
    transfer: ArmTrajectory
    approach: ArmTrajectory
    retreat: ArmTrajectory
    X_WG: Array
    held: HeldObject

    @property
    def duration(self) -> float:
        """Duration of all motions, s."""
        return sum(t.duration for t in (self.transfer, self.approach, self.retreat))


@dataclass(frozen=True)
class _Grasp:
    """Straight lines into and out of one grasp."""

    approach: Array
    retreat: Array
    X_WG: Array
    held: HeldObject


class ArmPlanner:
    """Plans against an estimated scene.

    Args:
        directives: robot, tools and everything that stands still in the cell.
        library: the objects that an estimate may name.
        config: names in the directives, distances and speeds.

    Raises:
        InputError: if the directives lack a name of the configuration.
    """

    def __init__(
        self,
        directives: Sequence[ModelDirective],
        library: ObjectLibrary,
        config: ArmPlannerConfig = ArmPlannerConfig(),  # noqa: B008 (frozen)
    ) -> None:
        self.config, self.library = config, library
        self.scene = PlanningScene(directives, library, config)

    @property
    def home(self) -> Array:
        """The home posture, (n,)."""
        return np.array(self.config.home)

    def set_scene(self, estimate: SceneEstimate) -> None:
        """From now on, plans among those objects of an estimate that were found."""
        self.scene.set_objects(placed_objects(estimate, self.library))

    def set_other_joints(self, angles: Mapping[str, float]) -> None:
        """Sets the angles of joints that are not planned, rad by name."""
        self.scene.set_other_joints(angles)

    def solve_ik(
        self,
        X_WG: Array,
        q_near: Array,
        *,
        free_turn: bool = True,
        cone: float = 0.0,
        radius: float = 0.0,
    ) -> Array:
        """Finds a collision-free configuration with the cup at a pose.

        Args:
            X_WG: the pose, (4, 4).
            q_near: configuration that the solution should be near, (n,).
            free_turn: whether any turn about the cup's axis will do.
            cone: angle that the cup's axis may be off by, rad.
            radius: distance that the lip's centre may be off by, m.

        Raises:
            PlanFailure: if there is no such configuration.
        """
        goal = PoseGoal(self.scene.tool_frame, X_WG, free_turn, cone, radius)
        search = IkSearch(self.scene, goal, q_near, self._generator())
        for q in search:
            return q
        raise search.failure("ik", "the cup's pose")

    def plan_to(
        self, q_start: Array, q_goal: Array, held: HeldObject | None = None
    ) -> ArmTrajectory:
        """Moves the arm to a configuration.

        Args:
            q_start: current configuration of the arm, (n,).
            q_goal: configuration at the end, (n,).
            held: the object at the cup.

        Raises:
            PlanFailure: if no way is found.
        """
        with self.scene.state(held=held, start=q_start):
            path = connect(self.scene, q_start, q_goal, self._generator(), "transfer")
            return self._timed(path, held is not None, "transfer")

    def plan_pick(self, q_now: Array, candidate: PickCandidate) -> PickPlan:
        """Plans reaching for an object, pressing the cup on it and lifting it.

        Args:
            q_now: current configuration of the arm, (n,).
            candidate: what to pick; its index refers to the scene that is set.

        Raises:
            PlanFailure: if no configuration, line or way is found.
        """
        scene, generator = self.scene, self._generator()
        X_pre = candidate.X_WG.copy()
        X_pre[:3, 3] -= self.config.pre_grasp * candidate.approach
        search = IkSearch(scene, PoseGoal(scene.tool_frame, X_pre), q_now, generator)
        failure: PlanFailure | None = None
        searches = 0
        with scene.state(start=q_now):
            for q in islice(search, self.config.line_attempts):
                try:
                    grasp = self._grasp(q, candidate)
                    searches += 1
                    path = connect(scene, q_now, q, generator, "transfer")
                    transfer = self._timed(path, False, "transfer")
                    return self._pick_plan(candidate, transfer, grasp)
                except PlanFailure as error:
                    failure = error
                    if searches == _MAX_SEARCHES:
                        break
            what = f"the pre-grasp above {candidate.name}"
            raise failure or search.failure("ik", what)

    def plan_place(
        self,
        q_now: Array,
        X_WG_place: Array,
        held: HeldObject,
        *,
        free_turn: bool = True,
        cone: float = 0.0,
    ) -> ArmTrajectory:
        """Carries the held object to where it is let go.

        Args:
            q_now: current configuration of the arm, (n,).
            X_WG_place: the cup's pose there, (4, 4); see `drop_pose`.
            held: the object.
            free_turn: whether any turn about the cup's axis will do.
            cone: angle that the cup's axis may be off by, rad.

        Raises:
            PlanFailure: if no configuration or way is found.
        """
        goal = PoseGoal(self.scene.tool_frame, X_WG_place, free_turn, cone)
        return self._plan_to_pose(q_now, goal, held, "carry", "the drop pose")

    def plan_line(
        self, q_now: Array, shift_W: Array, held: HeldObject | None = None
    ) -> ArmTrajectory:
        """Moves the cup along a straight line, without turning it.

        Args:
            q_now: current configuration of the arm, (n,).
            shift_W: vector that the cup moves along, (3,), m.
            held: the object at the cup.

        Raises:
            PlanFailure: if the arm cannot follow the line, or would touch something.
        """
        scene = self.scene
        with scene.state(held=held, start=q_now):
            path = straight_line(scene, scene.tool_frame, q_now, shift_W, "line")
            return self._timed_line(path, held is not None, "line")

    def plan_look(
        self,
        q_now: Array,
        X_WC: Array,
        held: HeldObject | None = None,
        *,
        cone: float = _LOOK_CONE,
        radius: float = _LOOK_RADIUS,
    ) -> ArmTrajectory:
        """Brings the camera to a viewpoint, with any turn about the optical axis.

        Args:
            q_now: current configuration of the arm, (n,).
            X_WC: the camera's pose, (4, 4).
            held: the object at the cup.
            cone: angle that the optical axis may be off by, rad.
            radius: distance that the camera may be off by, m.

        Raises:
            PlanFailure: if no configuration or way is found.
        """
        goal = PoseGoal(self.scene.camera_frame, X_WC, True, cone, radius)
        return self._plan_to_pose(q_now, goal, held, "look", "the viewpoint")

    def reachable_viewpoints(
        self, p_WT: Array, q_now: Array, p_WR: Array | None = None
    ) -> Iterator[Viewpoint]:
        """Proposes viewpoints around a target that the arm can take.

        Args:
            p_WT: what to look at, (3,), m.
            q_now: current configuration of the arm, (n,).
            p_WR: position of the robot's base, (3,), m; the world's origin if None.

        Yields:
            at most one for each side: front, left, right, top.
        """
        done: set[str] = set()
        stand = np.zeros(3) if p_WR is None else p_WR
        for view in propose_viewpoints(p_WT, stand):
            if view.name in done:
                continue
            goal = PoseGoal(
                self.scene.camera_frame, view.X_WC, True, _LOOK_CONE, _LOOK_RADIUS
            )
            with self.scene.state():
                search = IkSearch(self.scene, goal, q_now, self._generator())
                reachable = next(iter(search), None) is not None
            if reachable:
                done.add(view.name)
                yield view

    def _plan_to_pose(
        self,
        q_now: Array,
        goal: PoseGoal,
        held: HeldObject | None,
        stage: str,
        what: str,
    ) -> ArmTrajectory:
        scene, generator = self.scene, self._generator()
        search = IkSearch(scene, goal, q_now, generator)
        failure: PlanFailure | None = None
        with scene.state(held=held, start=q_now):
            for q in islice(search, _MAX_SEARCHES):
                try:
                    path = connect(scene, q_now, q, generator, stage)
                    return self._timed(path, held is not None, stage)
                except PlanFailure as error:
                    failure = error
            raise failure or search.failure(stage, what)

    def _grasp(self, q_pre: Array, candidate: PickCandidate) -> _Grasp:
        """Straight lines from a pre-grasp to contact, and off with the object."""
        scene, config = self.scene, self.config
        depth = config.pre_grasp + candidate.dome + config.press
        shift = depth * candidate.approach
        with scene.state(touch=candidate.index):
            approach = straight_line(scene, scene.tool_frame, q_pre, shift, "approach")
        X_WG = scene.tool_pose(approach[-1])
        X_GO = inverse(X_WG) @ candidate.X_WO
        held = HeldObject(candidate.object_id, X_GO, candidate.index)
        with scene.state(held=held, start=approach[-1]):
            retreat = self._retreat(approach[-1], candidate)
        return _Grasp(approach, retreat, X_WG, held)

    def _retreat(self, q: Array, candidate: PickCandidate) -> Array:
        """A straight line off: upwards, or if that fails, back along the cup's axis."""
        up = np.array([0.0, 0.0, self.config.lift])
        back = -self.config.lift * candidate.approach
        failures = []
        for away in (up, back):
            try:
                return straight_line(
                    self.scene, self.scene.tool_frame, q, away, "retreat"
                )
            except PlanFailure as failure:
                failures.append(failure)
        raise failures[0]

    def _pick_plan(
        self, candidate: PickCandidate, transfer: ArmTrajectory, grasp: _Grasp
    ) -> PickPlan:
        return PickPlan(
            candidate,
            transfer,
            self._timed_line(grasp.approach, False, "approach"),
            self._timed_line(grasp.retreat, True, "retreat"),
            grasp.X_WG,
            grasp.held,
        )

    def _timed_line(self, path: Array, loaded: bool, stage: str) -> ArmTrajectory:
        pace = self._pace(loaded, self.config.line_speed)
        trajectory = line_trajectory(self.scene, path, pace)
        if trajectory is None:
            raise PlanFailure(stage, "the straight line could not be timed")
        return trajectory

    def _timed(self, path: Array, loaded: bool, stage: str) -> ArmTrajectory:
        trajectory = smooth_trajectory(self.scene, path, self._pace(loaded))
        if trajectory is None:
            raise PlanFailure(stage, "the way that was found could not be smoothed")
        return trajectory

    def _pace(self, loaded: bool, line_speed: float | None = None) -> Pace:
        share = self.config.carry if loaded else 1.0
        return Pace(
            share * self.config.speed, share * self.config.acceleration, line_speed
        )

    def _generator(self) -> np.random.Generator:
        return np.random.default_rng(self.config.seed)


def drop_pose(library: ObjectLibrary, held: HeldObject, p_WD: Array) -> Array:
    """The cup's pose, pointing down, from which a held object falls on a point.

    Args:
        library: with the object's model.
        held: the object at the cup.
        p_WD: point that the object's lowest point is to reach, (3,), m.

    Returns:
        X_WG (4, 4); its turn about the cup's axis does not matter.
    """
    vertices = np.asarray(library[held.object_id].mesh.vertices)
    below = float(transform_points(held.X_GO, vertices)[:, 2].max())
    X = np.eye(4)
    X[:3, :3] = np.diag([1.0, -1.0, -1.0])
    X[:3, 3] = p_WD + np.array([0.0, 0.0, max(below, 0.0)])
    return X
