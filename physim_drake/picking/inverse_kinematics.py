# SPDX-License-Identifier: MIT
"""Configurations that bring a frame of the arm to a pose, free of collision.

Drake's `InverseKinematics` solves from several start guesses, and solutions are checked
with the paddings of the scene. If every solution of a round touches something, the
round is solved again with all distances as constraints, which is ten times slower.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.math import RotationMatrix
from pydrake.multibody.inverse_kinematics import (
    InverseKinematics,
    MinimumDistanceLowerBoundConstraint,
)
from pydrake.multibody.tree import Frame
from pydrake.solvers import SnoptSolver, SolverOptions
from scipy.spatial.transform import Rotation

from physim_drake.picking.planner_config import PlanFailure
from physim_drake.picking.planning_scene import PlanningScene
from physim_drake.poses import Array

_POSITION_TOLERANCE = 1e-3  # m; refined afterwards
_ANGLE_TOLERANCE = 3e-3  # rad
_INFLUENCE = 0.02  # m
_PER_ROUND = 6
_APART_GUESSES = 2
_SAME = 0.05  # rad
_SPREAD = 0.7  # rad


@dataclass(frozen=True)
class PoseGoal:
    """Where a frame is to go.

    Attributes:
        frame: frame of the robot.
        X_WF: pose that it is to have, (4, 4).
        free_turn: whether any turn about its z axis will do.
        cone: angle that its z axis may be off by, rad.
        radius: distance that its origin may be off by, m.
    """

    frame: Frame
    X_WF: Array
    free_turn: bool = True
    cone: float = 0.0
    radius: float = 0.0


class IkSearch:
    """Finds configurations that reach a goal, one after the other as it is iterated.

    Within each round of start guesses those near `q_near` come first. All are free of
    collision and differ from each other.

    Args:
        scene: robot, cell and objects, with its paddings set.
        goal: the pose.
        q_near: configuration that the arm should stay near, (n,).
        generator: random source of the start guesses.

    Attributes:
        blocked: a configuration that reached the goal but touches something.
    """

    def __init__(
        self,
        scene: PlanningScene,
        goal: PoseGoal,
        q_near: Array,
        generator: np.random.Generator,
    ) -> None:
        self._scene, self._goal, self._q_near = scene, goal, q_near
        self._guesses = _start_guesses(scene, q_near, generator)
        self._seen: list[Array] = []
        self.blocked: Array | None = None

    def __iter__(self) -> Iterator[Array]:
        """Yields configurations (n,)."""
        for _ in range(max(self._scene.config.ik_seeds // _PER_ROUND, 1)):
            batch = [next(self._guesses) for _ in range(_PER_ROUND)]
            free = self._round(batch, apart=False)
            if not free and self.blocked is not None:
                free = self._round(batch[:_APART_GUESSES], apart=True)
            yield from free

    def failure(self, stage: str, what: str) -> PlanFailure:
        """Says why nothing was found."""
        p = np.round(self._goal.X_WF[:3, 3], 3).tolist()
        if self.blocked is None:
            reason = f"no configuration within the joints' limits reaches {what} at {p}"
        else:
            conflicts = self._scene.conflicts(self.blocked)
            reason = f"no collision-free configuration reaches {what} at {p}"
            reason += f": too near are {conflicts}" if conflicts else ""
        return PlanFailure(stage, reason)

    def _round(self, guesses: list[Array], apart: bool) -> list[Array]:
        """The new free solutions from some guesses, the nearest first."""
        scene, found = self._scene, []
        for guess in guesses:
            q = _solve(scene, self._goal, self._q_near, guess, apart)
            if q is None or any(np.abs(q - s).max() < _SAME for s in self._seen):
                continue
            if scene.is_free(q):
                self._seen.append(q)
                found.append(q)
            else:
                self.blocked = q
        return sorted(found, key=lambda q: scene.distance(q, self._q_near))


def _solve(
    scene: PlanningScene, goal: PoseGoal, q_near: Array, guess: Array, apart: bool
) -> Array | None:
    plant = scene.plant
    problem: Any = InverseKinematics(plant, with_joint_limits=False)
    program, q = problem.prog(), problem.q()
    full = scene.full(guess)
    planned = scene.columns
    rest = np.setdiff1d(np.arange(len(full)), planned)
    if len(rest):
        program.AddBoundingBoxConstraint(full[rest], full[rest], q[rest])
    program.AddBoundingBoxConstraint(scene.lower, scene.upper, q[planned])
    _add_goal(problem, goal, plant.world_frame())
    # Only breaks ties between solutions, so that it does not slow the solver down.
    program.AddQuadraticErrorCost(0.1 * np.diag(scene.weights**2), q_near, q[planned])
    if apart:
        checker = scene.checker
        make_constraint: Any = MinimumDistanceLowerBoundConstraint
        program.AddConstraint(
            make_constraint(
                collision_checker=checker,
                bound=0.0,
                collision_checker_context=checker.MakeStandaloneModelContext(),
                penalty_function=None,
                influence_distance_offset=_INFLUENCE,
            ),
            q,
        )
    options = SolverOptions()
    # Without it, a hopeless guess can take seconds.
    options.SetOption(SnoptSolver.id(), "Major iterations limit", 60)
    solver: Any = SnoptSolver()
    result = solver.Solve(program, full, options)
    if not result.is_success():
        return None
    solution = scene.part(result.GetSolution(q))
    return refine(scene, goal, solution)


def _add_goal(problem: Any, goal: PoseGoal, world: Frame) -> None:
    p, R = goal.X_WF[:3, 3], goal.X_WF[:3, :3]
    slack = max(goal.radius / np.sqrt(3), _POSITION_TOLERANCE)
    problem.AddPositionConstraint(goal.frame, np.zeros(3), world, p - slack, p + slack)
    angle = max(goal.cone, _ANGLE_TOLERANCE)
    if goal.free_turn or goal.cone > 0:
        problem.AddAngleBetweenVectorsConstraint(
            world, R[:, 2], goal.frame, np.array([0.0, 0.0, 1.0]), 0.0, angle
        )
    else:
        problem.AddOrientationConstraint(
            world, RotationMatrix(R), goal.frame, RotationMatrix(), angle
        )


def refine(
    scene: PlanningScene, goal: PoseGoal, q: Array, iterations: int = 12
) -> Array | None:
    """Brings a frame exactly to its goal by damped Newton steps.

    Args:
        scene: the robot.
        goal: the pose; within its cone and radius, and in a turn that is free, the
            frame stays as it is.
        q: a configuration near the goal, (n,).
        iterations: greatest number of steps.

    Returns:
        the configuration, to 1e-6 m and rad; None if it is not reached within the
        joints' limits.
    """
    for _ in range(iterations):
        error = _pose_error(scene.pose(goal.frame, q), goal)
        if np.abs(error).max() < 1e-6:
            return q
        J = scene.jacobian(goal.frame, q)
        step = J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), error)
        q = np.clip(q + step, scene.lower, scene.upper)
    return None


def _pose_error(X_WF: Array, goal: PoseGoal) -> Array:
    """Rotation vector and translation from a pose to the nearest that will do, (6,)."""
    shift = goal.X_WF[:3, 3] - X_WF[:3, 3]
    excess = float(np.linalg.norm(shift)) - goal.radius
    shift = shift * (excess / (excess + goal.radius)) if excess > 0 else 0 * shift
    if goal.free_turn:
        have, want = X_WF[:3, 2], goal.X_WF[:3, 2]
        axis = np.cross(have, want)
        sine, cosine = float(np.linalg.norm(axis)), float(have @ want)
        angle = max(np.arctan2(sine, cosine) - goal.cone, 0.0)
        turn = axis * (angle / sine) if sine > 1e-12 else np.zeros(3)
    else:
        R = goal.X_WF[:3, :3] @ X_WF[:3, :3].T
        turn = Rotation.from_matrix(R).as_rotvec()
    return np.concatenate([turn, shift])


def _start_guesses(
    scene: PlanningScene, q_near: Array, generator: np.random.Generator
) -> Iterator[Array]:
    """The present posture, the home posture, then random ones near home and far."""
    home = np.array(scene.config.home)
    yield q_near
    yield home
    while True:
        near = home + _SPREAD * generator.normal(size=len(home))
        yield np.clip(near, scene.lower, scene.upper)
        yield generator.uniform(scene.lower, scene.upper)
