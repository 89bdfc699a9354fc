# SPDX-License-Identifier: MIT
"""Places objects so that they depend on each other, or not, once they settle.

Random drops rarely make a bridge or a stack, so groups are built: an object is brought
over or beside another one and moved until it touches. Physics then decides.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from physim_drake.objects.containers import Container
from physim_drake.poses import Array, make_pose
from physim_drake.scenes.plant import CONTAINER, ScenePlant
from physim_drake.scenes.resting_poses import RestingShape, resting_shape, turned

_GAP = 1e-4  # m, to which objects are brought near
_LOOK = 0.05  # m, up to which distances are computed
_CLEARANCE = 0.012  # m, between objects that do not depend on each other
_BESIDE = 0.02  # m, first gap to an object that is then approached
_SINGLE_TRIES = 40
_MAX_RISE = 0.6  # sine of the steepest slope of an object that leans

# Probabilities of the ways to build a group, in the order of `Placer.place`.
_WEIGHTS = {
    1: (1.0,),
    2: (0.35, 0.35, 0.2, 0.1),
    3: (0.3, 0.3, 0.1, 0.2, 0.1),
}
_PILE_WIDTH = 0.4  # of the side of a square that the objects would cover side by side

UP = np.array([0.0, 0.0, 1.0])


class NotPlacedError(Exception):
    """There was no room for an object, which the message names."""


class Placer:
    """Places the objects of one scene.

    Args:
        plant: plant of the scene, with all objects parked.
        container: support of the objects.
        rng: source of all random choices.
    """

    def __init__(
        self, plant: ScenePlant, container: Container, rng: np.random.Generator
    ) -> None:
        self._plant, self._container, self._rng = plant, container, rng
        self._shapes = [resting_shape(model) for model in plant.objects]
        self._R: dict[int, Array] = {}
        self._center: dict[int, Array] = {}

    def place(self, groups: Sequence[Sequence[int]]) -> tuple[str, ...]:
        """Places groups of objects, each apart from the others.

        Args:
            groups: indices of the objects that shall depend on each other; more than
                three make a pile.

        Returns:
            kind of each group.

        Raises:
            NotPlacedError: if there is no room.
        """
        builders: dict[int, dict[str, Callable[..., None]]] = {
            1: {"single": self._build_single},
            2: {
                "stack": self._build_stack,
                "lean": self._build_lean,
                "beside": self._build_beside,
                "drop": self._build_drop,
            },
            3: {
                "tower": self._build_tower,
                "bridge": self._build_bridge,
                "lean on pair": self._build_lean_on_pair,
                "row": self._build_row,
                "heap": self._build_heap,
            },
        }
        kinds = []
        for group in groups:
            if len(group) not in builders:
                self._build_pile(group)
                kinds.append("pile")
                continue
            options = builders[len(group)]
            kind = str(self._rng.choice(list(options), p=_WEIGHTS[len(group)]))
            options[kind](*group)
            kinds.append(kind)
        return tuple(kinds)

    def _build_single(self, k: int) -> None:
        self._stand(k, self._shapes[k].draw(self._rng))

    def _build_stack(self, a: int, b: int) -> None:
        self._build_single(a)
        self._put_on(a, b)

    def _build_lean(self, a: int, b: int) -> None:
        self._build_single(a)
        self._lean_on(a, b)

    def _build_beside(self, a: int, b: int) -> None:
        self._build_single(a)
        self._put_beside(a, b)

    def _build_drop(self, a: int, b: int) -> None:
        self._build_single(a)
        self._drop_near(a, b)

    def _build_tower(self, a: int, b: int, c: int) -> None:
        self._build_stack(a, b)
        self._put_on(b, c)

    def _build_bridge(self, a: int, b: int, c: int) -> None:
        """Two objects of similar height with a gap, and the third across."""
        self._build_single(a)
        R_b = self._of_similar_height(b, self._half_height(a))
        direction = self._bearing()
        R_c = self._along(c, direction)
        gap = self._rng.uniform(0.2, 0.5) * self._shapes[c].half_width(R_c, direction)
        self._set_beside(a, b, R_b, direction, gap)
        self._lower(b)
        middle = (self._center[a] + self._center[b]) / 2
        self._put_over(c, R_c, middle[:2])

    def _build_lean_on_pair(self, a: int, b: int, c: int) -> None:
        self._build_stack(a, b)
        self._lean_on(a, c)

    def _build_row(self, a: int, b: int, c: int) -> None:
        self._build_beside(a, b)
        self._put_beside(b, c)

    def _build_heap(self, a: int, b: int, c: int) -> None:
        self._build_stack(a, b)
        self._drop_near(a, c)

    def _build_pile(self, group: Sequence[int]) -> None:
        """Each object is lowered near the first, onto those that are there already."""
        x, y = np.eye(3)[:2]
        R_WO = {k: self._shapes[k].draw(self._rng) for k in group}
        area = sum(
            4 * self._shapes[k].half_width(R, x) * self._shapes[k].half_width(R, y)
            for k, R in R_WO.items()
        )
        self._stand(group[0], R_WO[group[0]])
        middle, half = self._center[group[0]][:2], _PILE_WIDTH * np.sqrt(area) / 2
        for k in group[1:]:
            self._put_over(k, R_WO[k], middle + self._rng.uniform(-half, half, 2))

    def _stand(self, k: int, R_WO: Array) -> None:
        """Puts object `k` on the surface, away from all others, near the middle."""
        half = self._container.half_extents
        for n in range(_SINGLE_TRIES):
            spread = (0.2 + 0.8 * n / _SINGLE_TRIES) * half
            xy = self._rng.uniform(-spread, spread)
            if not self._fits(k, R_WO, xy):
                continue
            self._put_over(k, R_WO, xy, start=self._shapes[k].half_width(R_WO, UP))
            if self._apart(k):
                return
            self._plant.park(k)
        raise NotPlacedError(f"no room for {self._plant.objects[k].name}")

    def _apart(self, k: int) -> bool:
        """Whether object `k` is clear of all others and of walls."""
        near = self._plant.distances(_CLEARANCE)
        return all(k not in pair or pair[0] < 0 <= d for pair, d in near.items())

    def _fits(self, k: int, R_WO: Array, xy: Array) -> bool:
        """Whether object `k` over `xy` (2,) lies within the area for objects."""
        reach = [self._shapes[k].half_width(R_WO, axis) for axis in np.eye(3)[:2]]
        return bool((np.abs(xy) + reach <= self._container.half_extents).all())

    def _put_on(self, a: int, b: int) -> None:
        """Lays object `b` on object `a`."""
        offset = self._rng.uniform(-0.4, 0.4, 2) * [
            self._shapes[a].half_width(self._R[a], axis) for axis in np.eye(3)[:2]
        ]
        xy = self._center[a][:2] + offset
        self._put_over(b, self._shapes[b].draw(self._rng), xy)

    def _drop_near(self, a: int, b: int) -> None:
        """Lets object `b` fall, turned any way, onto or beside object `a`."""
        reach = self._shapes[a].half_width(self._R[a], self._bearing())
        xy = self._center[a][:2] + self._rng.uniform(-reach, reach, 2)
        self._put_over(b, Rotation.random(rng=self._rng).as_matrix(), xy)

    def _put_beside(self, a: int, b: int) -> None:
        """Stands object `b` beside `a`, touching it."""
        direction = self._bearing()
        R_b = self._shapes[b].draw(self._rng)
        self._set_beside(a, b, R_b, direction, _BESIDE)
        self._lower(b)
        self._move(b, -direction, 0.5, [j for j in self._R if j != b])

    def _lean_on(self, a: int, b: int) -> None:
        """Puts one side of object `b` on `a` and lets the other reach the surface."""
        direction = self._bearing()
        R_b = self._along(b, direction)
        width = 2 * self._shapes[b].half_width(R_b, direction)
        rise = self._center[a][2] + self._half_height(a)
        tilt = np.arcsin(min(rise / width, _MAX_RISE))
        R_b = Rotation.from_rotvec(tilt * np.cross(UP, direction)).as_matrix() @ R_b
        overlap = self._rng.uniform(0.1, 0.35) * width
        self._set_beside(a, b, R_b, direction, -overlap)
        self._put_over(b, R_b, self._center[b][:2])

    def _set_beside(
        self, a: int, b: int, R_WO: Array, direction: Array, gap: float
    ) -> None:
        """Holds object `b` beside `a`, with a gap along a horizontal direction, m."""
        reach = self._shapes[a].half_width(self._R[a], direction)
        reach += self._shapes[b].half_width(R_WO, direction) + gap
        center = self._center[a] + reach * direction
        center[2] = self._shapes[b].half_width(R_WO, UP) + 0.002
        self._set(b, R_WO, center)

    def _put_over(
        self, k: int, R_WO: Array, xy: Array, start: float | None = None
    ) -> None:
        """Lowers object `k` onto what is under `xy` (2,), m, from a height `start`."""
        half = self._shapes[k].half_width(R_WO, UP)
        top = max([0.0, *(self._center[j][2] + self._half_height(j) for j in self._R)])
        height = top + half if start is None else start
        if height + half > self._container.height:
            raise NotPlacedError(f"no height for {self._plant.objects[k].name}")
        self._set(k, R_WO, np.array([*xy, height + 0.002]))
        self._lower(k)

    def _lower(self, k: int) -> None:
        self._move(k, -UP, self._center[k][2] + 0.01, [CONTAINER, *self._R])

    def _move(
        self, k: int, direction: Array, limit: float, obstacles: Sequence[int]
    ) -> None:
        """Moves object `k` until it touches an obstacle, at most `limit` m.

        Conservative advancement: a step by the distance of the nearest body is safe.
        """
        moved = 0.0
        while moved < limit:
            room = self._plant.clearance(k, obstacles, _LOOK)
            if room < _GAP:
                return
            step = min(max(room - _GAP / 2, _GAP / 2), limit - moved)
            moved += step
            self._set(k, self._R[k], self._center[k] + step * direction)

    def _set(self, k: int, R_WO: Array, center: Array) -> None:
        shape: RestingShape = self._shapes[k]
        self._R[k], self._center[k] = R_WO, center
        self._plant.set_pose(k, make_pose(R_WO, center - shape.center(R_WO)))

    def _half_height(self, k: int) -> float:
        return self._shapes[k].half_width(self._R[k], UP)

    def _of_similar_height(self, k: int, half_height: float) -> Array:
        """The resting orientation of `k` whose half height is nearest, turned."""
        options = self._shapes[k].R_WO
        if len(options) == 0:
            return self._shapes[k].draw(self._rng)
        heights = [self._shapes[k].half_width(R, UP) for R in options]
        best = int(np.abs(np.array(heights) - half_height).argmin())
        return turned(options[best], self._rng.uniform(-np.pi, np.pi))

    def _along(self, k: int, direction: Array) -> Array:
        """The resting orientation of `k` that reaches farthest along a direction."""
        options = [self._shapes[k].draw(self._rng) for _ in range(12)]
        return max(options, key=lambda R: self._shapes[k].half_width(R, direction))

    def _bearing(self) -> Array:
        """A horizontal unit vector, (3,)."""
        angle = self._rng.uniform(-np.pi, np.pi)
        return np.array([np.cos(angle), np.sin(angle), 0.0])
