# SPDX-License-Identifier: MIT
"""The next pick: the first candidate whose motions can be planned."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from physim_drake.estimate import SceneEstimate
from physim_drake.objects import ObjectLibrary
from physim_drake.picking.arm_planner import PickPlan, drop_pose
from physim_drake.picking.planner_config import HeldObject, PlanFailure
from physim_drake.picking.policy import PickCandidate, PickOrder
from physim_drake.picking.trajectories import ArmTrajectory
from physim_drake.poses import Array, inverse, transform_points

_PILE = 0.35  # m; what is let go lies no higher over the tote's floor
_SAME_POINT = 0.012  # m; a point nearer to one that did not seal is not tried again


class MotionPlanner(Protocol):
    """What the task asks a planner; `ArmPlanner` is one."""

    def set_scene(self, estimate: SceneEstimate) -> None:
        """Plans from now on among these objects."""

    def plan_look(self, q_now: Array, X_WC: Array) -> ArmTrajectory:
        """Brings the camera to a pose."""

    def plan_pick(self, q_now: Array, candidate: PickCandidate) -> PickPlan:
        """Plans reaching for an object, pressing the cup on it and lifting it."""

    def plan_place(
        self, q_now: Array, X_WG_place: Array, held: HeldObject
    ) -> ArmTrajectory:
        """Carries the held object to where it is let go."""


@dataclass(frozen=True)
class Tote:
    """Where objects go.

    Attributes:
        X_WT: pose of its floor's middle, z up, (4, 4).
        half_extents: of the floor along its x and y, (2,), m.
        drops: points above which objects are let go, used in turn, p_WD (N, 3), m.
    """

    X_WT: Array
    half_extents: Array
    drops: Array

    def holds(self, p_W: Array) -> bool:
        """Whether a point (3,) is above or in the tote."""
        p_T = transform_points(inverse(self.X_WT), p_W[None])[0]
        inside = (np.abs(p_T[:2]) <= self.half_extents).all()
        return bool(inside and -0.05 < p_T[2] < _PILE)


@dataclass(frozen=True)
class Choice:
    """What is picked next, or why nothing is.

    Attributes:
        pick: the pick; None where there is none.
        carry: its object's way to the tote.
        drop: index of the tote's point that it goes to.
        reasons: why what came before it was not chosen, by the objects' names.
    """

    pick: PickPlan | None
    carry: ArmTrajectory | None
    drop: int
    reasons: Mapping[str, str]


def choose(
    planner: MotionPlanner,
    order: PickOrder,
    library: ObjectLibrary,
    tote: Tote,
    q: Array,
    next_drop: int,
    failed_points: Mapping[int, tuple[Array, ...]],
    max_plans: int,
) -> Choice:
    """Plans candidates in their order until one succeeds.

    Args:
        planner: with the estimated scene set.
        order: the candidates.
        library: the objects.
        tote: where objects go.
        q: where the arm is, (n,).
        next_drop: the tote's point to begin with.
        failed_points: points that did not seal, by object id, p_O (3,).
        max_plans: so many candidates are tried.
    """
    reasons = {item.name: item.reason for item in order.look_again}
    planned = 0
    for candidate in order:
        if _failed_before(candidate, failed_points):
            reasons.setdefault(candidate.name, "where the cup reaches, it did not seal")
            continue
        if planned == max_plans:
            reasons.setdefault(candidate.name, f"{max_plans} plans failed before it")
            continue
        planned += 1
        try:
            pick = planner.plan_pick(q, candidate)
            carry, drop = _plan_carry(planner, pick, library, tote, next_drop)
        except PlanFailure as failure:
            reasons.setdefault(candidate.name, str(failure))
            continue
        return Choice(pick, carry, drop, reasons)
    return Choice(None, None, next_drop, reasons)


def _failed_before(
    candidate: PickCandidate, failed_points: Mapping[int, tuple[Array, ...]]
) -> bool:
    return any(
        np.linalg.norm(candidate.p_O - p) < _SAME_POINT
        for p in failed_points.get(candidate.object_id, ())
    )


def _plan_carry(
    planner: MotionPlanner,
    pick: PickPlan,
    library: ObjectLibrary,
    tote: Tote,
    next_drop: int,
) -> tuple[ArmTrajectory, int]:
    failure: PlanFailure | None = None
    for n in range(len(tote.drops)):
        drop = (next_drop + n) % len(tote.drops)
        X_WG = drop_pose(library, pick.held, tote.drops[drop])
        try:
            return planner.plan_place(pick.retreat.end, X_WG, pick.held), drop
        except PlanFailure as error:
            failure = failure or error
    assert failure is not None
    raise failure
