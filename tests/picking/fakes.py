# SPDX-License-Identifier: MIT
"""An arm, a policy and a table that answer at once, for tests of the pick task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from physim_drake.objects.model import ObjectLibrary
from physim_drake.picking.arm_planner import PickPlan
from physim_drake.picking.planner_config import HeldObject, PlanFailure
from physim_drake.picking.policy import PickCandidate, PickConditions
from physim_drake.picking.scenario import TaskConfig
from physim_drake.picking.task import PickTask
from physim_drake.picking.tote import Tote
from physim_drake.picking.trajectories import ArmTrajectory
from physim_drake.poses import Array, make_pose
from physim_drake.scene_estimate import SceneEstimate
from tests.synthetic import ERASER, SOAP, library

CONFIG = TaskConfig(planning_time=0.1, settle_time=0.1, max_views=2, tries=2)
ON_TABLE = {SOAP: make_pose(p=[0.0, 0.0, 0.02]), ERASER: make_pose(p=[0.2, 0, 0.02])}
TOTE = Tote(make_pose(p=[5.0, 0, 0]), np.array([0.2, 0.2]), np.array([[5.0, 0, 0.1]]))


def motion(q_start: Array, q_end: Array, duration: float = 1.0) -> ArmTrajectory:
    return ArmTrajectory(
        ("joint",),
        np.array([0.0, duration]),
        np.stack([q_start, q_end]),
        np.zeros((2, 1)),
    )


@dataclass
class FakePlanner:
    """An arm of one joint: 1 above the table, 2 on it, 3 over the tote."""

    unreachable: set[int] = field(default_factory=set)
    views: int = 99
    scene: SceneEstimate | None = None

    def set_scene(self, estimate: SceneEstimate) -> None:
        self.scene = estimate

    def plan_look(self, q_now: Array, X_WC: Array) -> ArmTrajectory:
        if X_WC[0, 3] >= self.views:
            raise PlanFailure("look", "too far")
        return motion(q_now, np.array([1.0]))

    def plan_pick(self, q_now: Array, candidate: PickCandidate) -> PickPlan:
        if candidate.object_id in self.unreachable:
            raise PlanFailure("ik", "out of reach")
        above, on = np.array([1.0]), np.array([2.0])
        held = HeldObject(candidate.object_id, np.eye(4), candidate.index)
        return PickPlan(
            candidate,
            motion(q_now, above),
            motion(above, on),
            motion(on, above),
            candidate.X_WG,
            held,
        )

    def plan_place(
        self, q_now: Array, X_WG_place: Array, held: HeldObject
    ) -> ArmTrajectory:
        return motion(q_now, np.array([3.0]))

    def plan_line(
        self, q_now: Array, shift_W: Array, held: HeldObject | None
    ) -> ArmTrajectory:
        return motion(q_now, q_now + 0.1)


@dataclass(frozen=True)
class EachOnce:
    """One candidate an object that is sure enough, in the order of the estimate."""

    min_confidence: float = 0.5

    def order(
        self,
        estimate: SceneEstimate,
        library: ObjectLibrary,
        conditions: PickConditions = PickConditions(),  # noqa: B008 (frozen)
    ) -> Sequence[PickCandidate]:
        return [
            PickCandidate(
                index=n,
                object_id=o.object_id,
                name=o.name,
                confidence=o.confidence,
                p_O=np.array([0.02 * k, 0.0, 0.0]),
                quality=1.0,
                X_WG=np.eye(4),
                tilt=0.0,
                clearance=0.1,
                dome=0.0,
                X_WO=o.X_WO,
            )
            for n, o in enumerate(estimate.objects)
            for k in range(3)
            if o.X_WO is not None
            and o.confidence >= self.min_confidence
            and n not in conditions.skip
        ]


def make_task(planner: FakePlanner | None = None, **changes: object) -> PickTask:
    task = PickTask(
        CONFIG,
        planner or FakePlanner(),
        EachOnce(),
        EachOnce(0.1),
        library(),
        PickConditions(),
        [make_pose(p=[float(n), 0, 0]) for n in range(3)],
        TOTE,
    )
    return replace(task, **changes)  # type: ignore[arg-type]
