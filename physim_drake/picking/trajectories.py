# SPDX-License-Identifier: MIT
"""Timed motions of the arm: smooth paths, as fast as the joints' limits allow.

A polyline becomes a cubic B-spline whose control points lie close together on it. Such
a spline is twice continuously differentiable, follows straight stretches exactly and
cuts a corner by less than a third of the spacing of the control points. Toppra (Pham
and Pham, "A new approach to time-optimal path parameterization", T-RO 2018) times it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from pydrake.math import BsplineBasis, KnotVectorType
from pydrake.multibody.optimization import CalcGridPointsOptions, Toppra
from pydrake.trajectories import (
    BsplineTrajectory,
    PathParameterizedTrajectory,
    PiecewisePolynomial,
)
from scipy.interpolate import CubicHermiteSpline

from physim_drake.picking.planning_scene import PlanningScene
from physim_drake.poses import Array

_SPACINGS = (0.2, 0.1, 0.05, 0.025, 0.0125)
"""m of motion between control points; wide ones make fast corners."""

_MIN_LENGTH = 1e-6  # m
_MAX_STEP = 0.02  # s between samples
_MIN_STEP = 1e-5
_MIN_DURATION = 0.02  # s


@dataclass(frozen=True)
class ArmTrajectory:
    """A motion of the planned joints, from rest to rest.

    Attributes:
        joints: names of the joints.
        times: (T,), s, from 0.
        q: (T, n), rad.
        v: (T, n), rad/s; in between, cubic Hermite interpolation.
    """

    joints: tuple[str, ...]
    times: Array
    q: Array
    v: Array

    @property
    def duration(self) -> float:
        """Of the whole motion, s."""
        return float(self.times[-1])

    @property
    def start(self) -> Array:
        """The first configuration, (n,)."""
        return np.array(self.q[0])

    @property
    def end(self) -> Array:
        """The last configuration, (n,)."""
        return np.array(self.q[-1])

    def value(self, t: float | Array) -> Array:
        """Configurations at times `t` (...), held beyond both ends, (..., n)."""
        return np.asarray(self._spline()(np.clip(t, 0.0, self.duration)))

    def velocity(self, t: float | Array) -> Array:
        """Velocities at times `t` (...), rad/s, 0 beyond both ends, (..., n)."""
        inside = (np.asarray(t) >= 0) & (np.asarray(t) <= self.duration)
        return np.asarray(np.where(inside[..., None], self._spline()(t, 1), 0.0))

    def to_drake(self) -> PiecewisePolynomial:
        """The same as a trajectory for Drake's `TrajectorySource`."""
        times, q, v = self.times, self.q.T, self.v.T
        spline: PiecewisePolynomial = PiecewisePolynomial.CubicHermite(times, q, v)
        return spline

    def _spline(self) -> CubicHermiteSpline:
        return CubicHermiteSpline(self.times, self.q, self.v)


@dataclass(frozen=True)
class Pace:
    """How fast a motion may be.

    Attributes:
        speed: share of the joints' speed limits.
        acceleration: share of their acceleration limits.
        line_speed: greatest speed of the tool frame's origin, m/s; None for no limit.
    """

    speed: float
    acceleration: float
    line_speed: float | None = None


def rest_trajectory(scene: PlanningScene, q: Array) -> ArmTrajectory:
    """A motion that stays where it is."""
    times = np.array([0.0, _MIN_DURATION])
    return ArmTrajectory(
        scene.config.joints, times, np.tile(q, (2, 1)), np.zeros((2, len(q)))
    )


def smooth_trajectory(
    scene: PlanningScene, path: Array, pace: Pace
) -> ArmTrajectory | None:
    """Rounds the corners of a free polyline and times it.

    Args:
        scene: robot and obstacles, with its paddings set.
        path: (N, n), free along all edges.
        pace: speed and acceleration.

    Returns:
        the motion; None if no rounding is free, or the timing fails.
    """
    ends = np.cumsum([0.0, *(scene.distance(a, b) for a, b in pairwise(path))])
    if ends[-1] < _MIN_LENGTH:
        return rest_trajectory(scene, path[0])
    for spacing in _SPACINGS:
        count = int(np.ceil(ends[-1] / spacing)) + 3
        controls = _control_points(path, ends / ends[-1], count)
        if len(path) == 2 or _spline_free(scene, controls):
            return _timed(scene, controls, pace)
    return None


def line_trajectory(
    scene: PlanningScene, path: Array, pace: Pace
) -> ArmTrajectory | None:
    """Times a dense path that is smooth already.

    Args:
        scene: the robot.
        path: (N, n), neighbours close together and evenly spaced.
        pace: speed and acceleration.
    """
    places = np.linspace(0.0, 1.0, len(path))
    return _timed(scene, _control_points(path, places, len(path) + 2), pace)


def _control_points(path: Array, places: Array, count: int) -> Array:
    """Control points on a polyline, where a spline follows straight lines evenly.

    At the Greville abscissae, the means of three knots, a cubic spline's control points
    reproduce a linear motion; the clamped ends would otherwise be run through faster.

    Args:
        path: (N, n).
        places: places of its points along the spline's parameter, (N,), from 0 to 1.
        count: number of control points, at least 4.
    """
    knots = np.concatenate([[0.0] * 3, np.linspace(0, 1, count - 2), [1.0] * 3])
    greville = (knots[1:-3] + knots[2:-2] + knots[3:-1]) / 3
    columns = [np.interp(greville, places, column) for column in path.T]
    return np.stack(columns, axis=1)


def _spline(controls: Array) -> Any:
    """The clamped cubic B-spline of control points (N, n), over 0..1."""
    basis = BsplineBasis(4, len(controls), KnotVectorType.kClampedUniform, 0.0, 1.0)
    return BsplineTrajectory(basis, [point[:, None] for point in controls])


def _spline_free(scene: PlanningScene, controls: Array) -> bool:
    length = sum(map(scene.distance, controls[:-1], controls[1:]))
    count = int(np.ceil(length / scene.config.resolution)) + 2
    points = _spline(controls).vector_values(np.linspace(0.0, 1.0, count)).T
    return scene.path_free(points)


def _timed(scene: PlanningScene, controls: Array, pace: Pace) -> ArmTrajectory | None:
    plant, path = scene.plant, _spline(scene.full(controls))
    grid = Toppra.CalcGridPoints(
        path, CalcGridPointsOptions(max_err=1e-4, max_seg_length=0.02, min_points=80)
    )
    toppra = Toppra(path, plant, grid)
    speed = pace.speed * plant.GetVelocityUpperLimits()
    toppra.AddJointVelocityLimit(-speed, speed)
    acceleration = plant.GetAccelerationUpperLimits()
    unlimited = ~np.isfinite(acceleration)
    acceleration[unlimited] = scene.config.default_acceleration
    acceleration *= pace.acceleration
    toppra.AddJointAccelerationLimit(-acceleration, acceleration)
    if pace.line_speed is not None:
        toppra.AddFrameTranslationalSpeedLimit(scene.tool_frame, pace.line_speed)
    timing = toppra.SolvePathParameterization()
    if timing is None:
        return None
    return _sampled(scene, PathParameterizedTrajectory(path, timing), timing)


def _sampled(scene: PlanningScene, trajectory: Any, timing: Any) -> ArmTrajectory:
    """Samples a motion at the jumps of its acceleration, and in between.

    Toppra's acceleration is constant along the path between its grid points; cubics
    that end there follow it, others would overshoot the limits by a tenth.
    """
    knots = np.array(timing.get_segment_times())
    knots = knots[np.append(True, np.diff(knots) > _MIN_STEP)]
    counts = np.ceil(np.diff(knots) / _MAX_STEP).astype(int)
    pieces = [
        np.linspace(a, b, n, endpoint=False)
        for (a, b), n in zip(pairwise(knots), counts, strict=True)
    ]
    times = np.concatenate([*pieces, [timing.end_time()]])
    q = scene.part(trajectory.vector_values(times).T)
    v = scene.part(np.stack([trajectory.EvalDerivative(t, 1)[:, 0] for t in times]))
    v[0] = v[-1] = 0.0
    return ArmTrajectory(scene.config.joints, times - times[0], q, v)
