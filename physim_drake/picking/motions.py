# SPDX-License-Identifier: MIT
"""Collision-free paths of the arm: between configurations, and along straight lines."""

from __future__ import annotations

from contextlib import suppress
from itertools import product

import numpy as np
from pydrake.multibody.tree import Frame

from physim_drake.picking.inverse_kinematics import PoseGoal, refine
from physim_drake.picking.planner_config import PlanFailure
from physim_drake.picking.planning_scene import PlanningScene
from physim_drake.picking.rrt_connect import rrt_connect, shortcut
from physim_drake.poses import Array

_MAX_STEP = 0.3  # rad between two points of a straight line


def connect(
    scene: PlanningScene,
    q_start: Array,
    q_goal: Array,
    generator: np.random.Generator,
    stage: str,
) -> Array:
    """Finds a free polyline between two configurations.

    The straight line, or one that begins or ends by lifting the tool straight up,
    else one by way of the home posture, else RRT-Connect; detours are cut short.

    Args:
        scene: robot and obstacles, with its paddings set.
        q_start: (n,).
        q_goal: (n,).
        generator: random source of the search.
        stage: name of the motion in messages.

    Returns:
        (N, n), both ends included.

    Raises:
        PlanFailure: if no way is found.
    """
    # At its present place the arm may have overshot into the margin that plans keep.
    for q, place, slack in (
        (q_start, "where the arm is", scene.config.limit_margin),
        (q_goal, "at the goal", 0.0),
    ):
        if not scene.within_limits(q, slack):
            raise PlanFailure(stage, f"a joint is beyond its limits {place}")
        if not scene.is_free(q):
            raise PlanFailure(stage, f"{place}, too near are {scene.conflicts(q)}")
    if scene.edge_free(q_start, q_goal):
        return np.stack([q_start, q_goal])
    path = _by_known_ways(scene, q_start, q_goal)
    if path is None:
        path = rrt_connect(
            q_start,
            q_goal,
            scene.lower,
            scene.upper,
            scene.weights,
            scene.edge_free,
            generator,
            scene.config.rrt_iterations,
        )
    if path is None:
        raise PlanFailure(
            stage,
            f"no way around the obstacles was found in {scene.config.rrt_iterations} "
            "samples",
        )
    return shortcut(path, scene.edge_free, scene.weights, generator)


def _by_known_ways(scene: PlanningScene, q_start: Array, q_goal: Array) -> Array | None:
    """A polyline of few straight motions, if one of the usual ones is free."""
    ups = [q_start[None]], [q_goal[None]]
    for q, choices in zip((q_start, q_goal), ups, strict=True):
        up = np.array([0.0, 0.0, scene.config.lift])
        with suppress(PlanFailure):
            choices.append(straight_line(scene, scene.tool_frame, q, up, "lift"))
    home = np.array(scene.config.home)
    for between in ([], [home]):
        for first, last in product(*ups):
            corners = np.array([first[-1], *between, last[-1]])
            if scene.path_free(corners):
                return np.concatenate([first[:-1], corners, last[-2::-1]])
    return None


def straight_line(
    scene: PlanningScene, frame: Frame, q_start: Array, shift_W: Array, stage: str
) -> Array:
    """Moves a frame along a straight line, without turning it.

    Args:
        scene: robot and obstacles, with its paddings set.
        frame: frame of the robot.
        q_start: configuration at the start of the line, (n,).
        shift_W: vector from there to its end, (3,), m.
        stage: name of the motion in messages.

    Returns:
        (N, n), points of the line `line_step` apart.

    Raises:
        PlanFailure: if the arm cannot follow the line, or would touch something.
    """
    X_start = scene.pose(frame, q_start)
    length = float(np.linalg.norm(shift_W))
    count = max(int(np.ceil(length / scene.config.line_step)), 3)
    path = [q_start]
    for share in np.arange(1, count + 1) / count:
        X = X_start.copy()
        X[:3, 3] += share * shift_W
        q = refine(scene, PoseGoal(frame, X, free_turn=False), path[-1])
        done = f"{1000 * share * length:.0f} of {1000 * length:.0f} mm"
        if q is None or np.abs(q - path[-1]).max() > _MAX_STEP:
            raise PlanFailure(
                stage, f"the arm cannot follow the straight line beyond {done}"
            )
        if not scene.edge_free(path[-1], q):
            raise PlanFailure(
                stage,
                f"{done} along the straight line, too near are {scene.conflicts(q)}",
            )
        path.append(q)
    return np.array(path)
