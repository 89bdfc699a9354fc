# SPDX-License-Identifier: MIT
"""The next pick: the first candidate whose motions can be planned."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from physim_drake.objects.model import ObjectLibrary
from physim_drake.picking.arm_planner import PickPlan, drop_pose
from physim_drake.picking.planner_config import HeldObject, PlanFailure
from physim_drake.picking.policy import PickCandidate, PickOrder
from physim_drake.picking.tote import Fills, Tote
from physim_drake.picking.trajectories import ArmTrajectory
from physim_drake.poses import Array
from physim_drake.scene_estimate import SceneEstimate

_DETOUR = 3.0  # s; a longer way to the tote is not the direct one
_SAME_POINT = 0.012  # m; a point nearer to one that did not seal is not tried again


class MotionPlanner(Protocol):
    """A planner as the task needs it, such as `ArmPlanner`."""

    def set_scene(self, estimate: SceneEstimate) -> None:
        """From now on, plans among these objects."""

    def plan_look(self, q_now: Array, X_WC: Array) -> ArmTrajectory:
        """Brings the camera to a pose."""
        ...

    def plan_pick(self, q_now: Array, candidate: PickCandidate) -> PickPlan:
        """Plans reaching for an object, pressing the cup on it and lifting it."""
        ...

    def plan_place(
        self, q_now: Array, X_WG_place: Array, held: HeldObject
    ) -> ArmTrajectory:
        """Carries the held object to a pose of the cup."""
        ...

    def plan_line(
        self, q_now: Array, shift_W: Array, held: HeldObject | None
    ) -> ArmTrajectory:
        """Moves the cup along a straight line."""
        ...


@dataclass(frozen=True)
class PickAndPlace:
    """All motions from where the arm is to where the object is let go.

    Attributes:
        pick: motions up to the object and off with it.
        carry: motion of the object to over the tote.
        lower: motion from there to where it is let go; None if it falls from there.
        drop: number of the tote's drop that it goes to.
    """

    pick: PickPlan
    carry: ArmTrajectory
    lower: ArmTrajectory | None
    drop: int


@dataclass(frozen=True)
class Choice:
    """What is picked next, or why nothing is.

    Attributes:
        plan: the motions; None if nothing can be picked.
        reasons: why what came before it was not chosen, by the objects' names.
    """

    plan: PickAndPlace | None
    reasons: Mapping[str, str]


def choose(
    planner: MotionPlanner,
    order: PickOrder,
    library: ObjectLibrary,
    tote: Tote,
    q: Array,
    fills: Fills,
    failed_points: Mapping[int, tuple[Array, ...]],
    max_plans: int,
) -> Choice:
    """Plans candidates in their order until one succeeds.

    Args:
        planner: with the estimated scene set.
        order: the candidates.
        library: the objects.
        tote: tote that objects go into.
        q: current configuration of the arm, (n,).
        fills: fill height below each drop of the tote, m.
        failed_points: points that did not seal, by object id, p_O (3,).
        max_plans: number of candidates that are planned at most.
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
            plan = _with_place(planner, pick, library, tote, fills)
        except PlanFailure as failure:
            reasons.setdefault(candidate.name, str(failure))
            continue
        return Choice(plan, reasons)
    return Choice(None, reasons)


def _failed_before(
    candidate: PickCandidate, failed_points: Mapping[int, tuple[Array, ...]]
) -> bool:
    return any(
        np.linalg.norm(candidate.p_O - p) < _SAME_POINT
        for p in failed_points.get(candidate.object_id, ())
    )


def _with_place(
    planner: MotionPlanner,
    pick: PickPlan,
    library: ObjectLibrary,
    tote: Tote,
    fills: Fills,
) -> PickAndPlace:
    """Carries the object over the walls first, then down as far as that can be.

    A long way has a detour. Another place in the tote may then be better.
    """
    failure: PlanFailure | None = None
    ways: list[tuple[ArmTrajectory, int]] = []
    for drop in tote.order(fills):
        X_WG = drop_pose(library, pick.held, tote.over(drop, fills))
        try:
            carry = planner.plan_place(pick.retreat.end, X_WG, pick.held)
        except PlanFailure as error:
            failure = failure or error
            continue
        ways.append((carry, drop))
        if carry.duration < _DETOUR:
            break
    if not ways:
        assert failure is not None
        raise failure
    carry, drop = min(ways, key=lambda way: way[0].duration)
    down = tote.release_point(drop, fills) - tote.over(drop, fills)
    try:
        lower = planner.plan_line(carry.end, down, pick.held)
    except PlanFailure:
        return PickAndPlace(pick, carry, None, drop)
    return PickAndPlace(pick, carry, lower, drop)
