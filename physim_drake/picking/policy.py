# SPDX-License-Identifier: MIT
"""Which object to pick next, and where.

A policy is one method. This one takes the surest object first:

    class SurestFirst:
        def order(self, estimate, library, conditions=PickConditions()):
            placed = placed_objects(estimate, library)
            found = (object_candidates(o, placed, conditions) for o in placed)
            return sorted(chain(*found), key=lambda c: -c.confidence)
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, overload

import numpy as np
from scipy.spatial.transform import Rotation

from physim_drake.objects.model import ObjectLibrary
from physim_drake.picking.piles import objects_on
from physim_drake.picking.suction_points import SuctionCup, suction_points
from physim_drake.picking.surroundings import (
    PlacedObject,
    ToolShape,
    Wall,
    placed_objects,
    tool_clearance,
)
from physim_drake.poses import Array, make_pose
from physim_drake.scene_estimate import SceneEstimate


@dataclass(frozen=True)
class PickConditions:
    """What holds for every candidate.

    Attributes:
        cup: the cup.
        tool: the shape of the tool behind it.
        walls: boxes of the cell that the tool must not touch.
        clearance: the tool keeps at least this distance from other objects and walls,
            m; that of the estimate's errors.
        max_tilt: greatest tilt of the cup's axis from the vertical, rad.
        per_object: greatest number of candidates of an object.
        spacing: least distance between candidates of one object, m.
        skip: indices of objects that are not wanted, for instance given up.
    """

    cup: SuctionCup = field(default_factory=SuctionCup)
    tool: ToolShape = field(default_factory=ToolShape)
    walls: tuple[Wall, ...] = ()
    clearance: float = 0.004
    max_tilt: float = float(np.radians(60.0))
    per_object: int = 8
    spacing: float = 0.02
    skip: frozenset[int] = frozenset()


@dataclass(frozen=True)
class PickCandidate:
    """One way to pick one object.

    Attributes:
        index: index of the object in the estimate.
        object_id: id of the object.
        name: name of the object.
        confidence: the estimate's, 0..1.
        p_O: the suction point, (3,), m.
        quality: quality of the suction point, 0..1.
        dome: the cup must be pressed on by this much before its lip lies on, m.
        X_WG: the cup's pose at contact, (4, 4): origin on the surface, z into it; the
            turn about z is arbitrary.
        tilt: tilt of the cup's axis from the vertical, rad.
        clearance: distance of the tool at contact to what is nearest of other objects
            and walls, m.
        X_WO: the object's estimated pose, (4, 4).
        cost: cost by the policy; smaller is better.
        reasons: descriptions of what raised the cost.
    """

    index: int
    object_id: int
    name: str
    confidence: float
    p_O: Array
    quality: float
    dome: float
    X_WG: Array
    tilt: float
    clearance: float
    X_WO: Array
    cost: float = 0.0
    reasons: tuple[str, ...] = ()

    @property
    def approach(self) -> Array:
        """Direction in which the cup moves towards the surface, unit, (3,), in W."""
        return np.array(self.X_WG[:3, 2])

    def poses(self, count: int = 8) -> Iterator[Array]:
        """The cup's pose at `count` even turns about its axis, X_WG first."""
        for n in range(count):
            turn = Rotation.from_rotvec([0.0, 0.0, 2 * np.pi * n / count])
            yield self.X_WG @ make_pose(turn.as_matrix())

    def __str__(self) -> str:
        text = (
            f"{self.name}: quality {self.quality:.2f}, tilt "
            f"{np.degrees(self.tilt):.0f} deg, clearance {1000 * self.clearance:.0f} mm"
        )
        return text + "".join(f"; {reason}" for reason in self.reasons)


@dataclass(frozen=True)
class LookAgain:
    """An object that another look should make surer before it is picked.

    Attributes:
        index: index of the object in the estimate.
        name: name of the object.
        reason: why it is not picked now.
    """

    index: int
    name: str
    reason: str


@dataclass(frozen=True)
class PickOrder(Sequence[PickCandidate]):
    """Candidates, best first, and the objects to look at again.

    Attributes:
        candidates: picks to choose from.
        look_again: what was not considered.
    """

    candidates: tuple[PickCandidate, ...]
    look_again: tuple[LookAgain, ...] = ()

    @classmethod
    def of(cls, order: Sequence[PickCandidate]) -> PickOrder:
        """From what any policy returns."""
        return order if isinstance(order, PickOrder) else cls(tuple(order))

    def __len__(self) -> int:
        return len(self.candidates)

    @overload
    def __getitem__(self, n: int) -> PickCandidate: ...

    @overload
    def __getitem__(self, n: slice) -> tuple[PickCandidate, ...]: ...

    def __getitem__(self, n: int | slice) -> PickCandidate | tuple[PickCandidate, ...]:
        return self.candidates[n]


class PickPolicy(Protocol):
    """Decides in which order candidates are tried."""

    def order(
        self,
        estimate: SceneEstimate,
        library: ObjectLibrary,
        conditions: PickConditions = PickConditions(),
    ) -> Sequence[PickCandidate]:
        """Returns the candidates to try, best first. A `PickOrder` may say more.

        Args:
            estimate: the scene.
            library: models of its objects.
            conditions: conditions that every candidate has in common.
        """
        ...


def object_candidates(
    target: PlacedObject,
    placed: Sequence[PlacedObject],
    conditions: PickConditions = PickConditions(),
) -> tuple[PickCandidate, ...]:
    """The ways to pick one object that its surroundings leave, good and upright first.

    Args:
        target: the object.
        placed: all objects of the estimate.
        conditions: tilt, clearance and number.
    """
    points = suction_points(target.model, conditions.cup)
    if len(points) == 0:
        return ()
    n_W = points.normals @ target.X_WO[:3, :3].T
    p_W = points.positions @ target.X_WO[:3, :3].T + target.X_WO[:3, 3]
    tilts = np.arccos(np.clip(n_W[:, 2], -1.0, 1.0))
    X_WG = _cup_poses(p_W, n_W)
    others = [item for item in placed if item is not target]
    usable = np.flatnonzero(tilts <= conditions.max_tilt)
    clearance = np.zeros(len(points))
    clearance[usable] = tool_clearance(
        X_WG[usable], conditions.tool, others, conditions.walls
    )
    chosen: list[int] = []
    worth = points.quality[usable] * np.cos(tilts[usable])
    for n in usable[np.argsort(-worth, kind="stable")]:
        near = np.linalg.norm(p_W[chosen] - p_W[n], axis=1) < conditions.spacing
        if clearance[n] >= conditions.clearance and not near.any():
            chosen.append(int(n))
    return tuple(
        PickCandidate(
            target.index,
            target.model.object_id,
            target.model.name,
            target.confidence,
            points.positions[n],
            float(points.quality[n]),
            max(float(points.dome[n]), 0.0),
            X_WG[n],
            float(tilts[n]),
            float(clearance[n]),
            target.X_WO,
        )
        for n in chosen[: conditions.per_object]
    )


def _cup_poses(p_W: Array, n_W: Array) -> Array:
    """X_WG (N, 4, 4) at points with outward normals, x as near to W's x as it goes."""
    z = -n_W
    helper = np.where(np.abs(z[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    x = helper - (helper * z).sum(axis=1, keepdims=True) * z
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    X = np.tile(np.eye(4), (len(p_W), 1, 1))
    X[:, :3, 0], X[:, :3, 1], X[:, :3, 2], X[:, :3, 3] = x, np.cross(z, x), z, p_W
    return X


@dataclass(frozen=True)
class TopOfPileFirst:
    """Takes what nothing lies on first, and the rest by a weighted cost.

    Attributes:
        min_confidence: objects below it are not picked but looked at again.
        burden: cost of an object on the one picked; larger than all others together.
        doubt: cost of confidence 0.
        poor_seal: cost of a suction point of quality 0.
        tilt: cost of a cup that comes in level.
        narrow: cost of a tool that only just has room.
        roomy: clearance that is not worth exceeding, m.
    """

    min_confidence: float = 0.5
    burden: float = 10.0
    doubt: float = 2.0
    poor_seal: float = 2.0
    tilt: float = 1.0
    narrow: float = 0.5
    roomy: float = 0.02

    def order(
        self,
        estimate: SceneEstimate,
        library: ObjectLibrary,
        conditions: PickConditions = PickConditions(),
    ) -> PickOrder:
        """Orders the candidates of all objects that are sure enough.

        Args:
            estimate: the scene.
            library: models of its objects.
            conditions: conditions that every candidate has in common.
        """
        placed = placed_objects(estimate, library)
        above = objects_on(placed)
        sure = [item for item in placed if item.confidence >= self.min_confidence]
        candidates = [
            self._judged(candidate, estimate, above[item.index])
            for item in sure
            if item.index not in conditions.skip
            for candidate in object_candidates(item, placed, conditions)
        ]
        candidates.sort(key=lambda c: c.cost)  # stable: ties keep the estimate's order
        return PickOrder(tuple(candidates), self._uncertain(estimate, conditions.skip))

    def _judged(
        self, candidate: PickCandidate, estimate: SceneEstimate, above: frozenset[int]
    ) -> PickCandidate:
        cramped = max(1 - candidate.clearance / self.roomy, 0.0)
        cost = (
            self.burden * len(above)
            + self.doubt * (1 - candidate.confidence)
            + self.poor_seal * (1 - candidate.quality)
            + self.tilt * candidate.tilt / (np.pi / 2)
            + self.narrow * cramped
        )
        reasons = []
        if above:
            names = ", ".join(estimate.objects[n].name for n in sorted(above))
            reasons.append(f"below {names}")
        if candidate.quality < 0.5:
            reasons.append("the cup seals poorly there")
        if candidate.tilt > np.radians(30.0):
            reasons.append("the surface is steep")
        if cramped > 0.5:
            reasons.append("there is little room for the tool")
        return replace(candidate, cost=float(cost), reasons=tuple(reasons))

    def _uncertain(
        self, estimate: SceneEstimate, skip: frozenset[int]
    ) -> tuple[LookAgain, ...]:
        doubtful = []
        for n, item in enumerate(estimate.objects):
            if n in skip:
                continue
            if not item.found:
                why = item.reason or "no pose explains it"
                doubtful.append(LookAgain(n, item.name, f"not found: {why}"))
            elif item.confidence < self.min_confidence:
                reason = (
                    f"confidence {item.confidence:.2f} is below "
                    f"{self.min_confidence:.2f}"
                )
                doubtful.append(LookAgain(n, item.name, reason))
        return tuple(doubtful)
