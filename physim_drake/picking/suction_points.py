# SPDX-License-Identifier: MIT
"""Where a suction cup can hold an object: measured on its surface, once a model.

A cup seals if its whole lip lies on the surface. The lip is a ring, which the
bellows tilt for free and bend by a few millimetres. So a plane is fitted to the surface
under the lip; what is left of the ring after the fit must be less than the bellows give
way. A ball passes, since a ring on it is plane; the dome in the middle must then fit
into the cup. How quality falls with the weight's lever arm follows the ring of contact
forces in Mahler et al., "Dex-Net 3.0" (ICRA 2018, section IV), with the vacuum as the
preload and no help from the lip's own stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from physim_drake.objects.model import ObjectModel
from physim_drake.picking.lip_rays import plane_axes, surface_heights
from physim_drake.poses import Array

_RING_RAYS = 24
_MARGIN_STEPS = 3
_RAY_REACH = 0.03  # m
_OVERHANG = 0.01  # m over the lip; what is higher hides the point
_MAX_REFIT = np.radians(30.0)  # tilt of the fitted plane from the face's normal
_GRAVITY = 9.81
_SAME_SIDE = np.cos(np.radians(35.0))


@dataclass(frozen=True)
class SuctionCup:
    """The cup, and how candidate points are chosen for it.

    Attributes:
        lip_radius: radius of the lip's ring, m.
        conformity: the lip follows a surface that leaves its mean plane by no more, m.
        depth: a dome under the cup may be this high over the lip's plane, m.
        margin: distance of the lip from an edge that is wished for, as an estimated
            pose errs; a point whose margin is zero is still one, of low quality, m.
        length: length of the straight tool behind the lip, which must not meet the
            object, m.
        holding_force: force of the full vacuum, N.
        samples: points of the surface that are tried.
        spacing: least distance of points that face the same way, m.
    """

    lip_radius: float = 0.015
    conformity: float = 0.002
    depth: float = 0.005
    margin: float = 0.006
    length: float = 0.2
    holding_force: float = 35.0
    samples: int = 500
    spacing: float = 0.008


@dataclass(frozen=True)
class SuctionPoints:
    """Candidate points of one object, best first.

    Attributes:
        positions: on the surface under the cup's centre, p_O (N, 3), m.
        normals: outward axis of the cup, unit, (N, 3).
        dome: height of the surface under the cup's centre over the lip's plane, (N,),
            m; the cup must be pressed on this far before its lip lies on.
        quality: 0..1, (N,): the product of the three below.
        flatness: 1 if the surface under the lip is plane, 0 at the conformity.
        leverage: 1 if the cup's axis meets the centre of mass, 0 if the weight, at its
            worst angle, would peel the lip off.
        margin: 1 if the lip keeps the wished distance from every edge, 0.3 if it is at
            one.
    """

    positions: Array
    normals: Array
    dome: Array
    quality: Array
    flatness: Array
    leverage: Array
    margin: Array

    def __len__(self) -> int:
        return len(self.positions)


@lru_cache(maxsize=256)
def suction_points(model: ObjectModel, cup: SuctionCup = SuctionCup()) -> SuctionPoints:
    """Finds where a cup seals on an object, and keeps it for the next call.

    Args:
        model: the object.
        cup: the cup.

    Returns:
        the points, spread over all of the surface that has any; none for an
        object too small or too curved for the cup. Do not write to them.
    """
    positions, normals = model.surface_sample(cup.samples)
    positions, normals, tilted = _seated(model, cup, positions, normals)
    ring = surface_heights(
        model.mesh, positions, normals, _ring(cup.lip_radius), _RAY_REACH
    )
    # NaN where a ray found nothing; comparisons with it are false.
    gap = np.abs(ring - ring.mean(axis=1, keepdims=True)).max(axis=1)
    dome = -ring.mean(axis=1)
    seals = tilted & (gap < cup.conformity) & (dome < cup.depth)
    seals[seals] = _accessible(model, cup, positions[seals], normals[seals])
    positions, normals = positions[seals], normals[seals]
    flatness = 1 - gap[seals] / cup.conformity
    leverage = _leverage(model, cup, positions, normals)
    margin = _margin(model, cup, positions, normals)
    quality = np.sqrt(flatness) * leverage * margin
    keep = _spread(positions, normals, quality, cup.spacing)
    parts = (positions, normals, dome[seals], quality, flatness, leverage, margin)
    chosen = [np.ascontiguousarray(part[keep]) for part in parts]
    for part in chosen:
        part.flags.writeable = False
    return SuctionPoints(*chosen)


def _ring(radius: float) -> Array:
    angles = 2 * np.pi * np.arange(_RING_RAYS) / _RING_RAYS
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _seated(
    model: ObjectModel, cup: SuctionCup, positions: Array, normals: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Turns each cup so that its lip rests on the surface, as its bellows would let it.

    Returns:
        positions and normals (N, 3), and whether the cup found its seat, (N,).
    """
    start = normals
    ring = _ring(cup.lip_radius)
    found = np.zeros(len(normals), dtype=bool)
    for _ in range(2):
        heights = surface_heights(model.mesh, positions, normals, ring, _RAY_REACH)
        # Least squares on an evenly spaced ring decouples into two sums.
        slopes = 2 * heights @ ring / (len(ring) * cup.lip_radius**2)
        x, y = plane_axes(normals)
        fitted = normals - slopes[:, :1] * x - slopes[:, 1:] * y
        fitted /= np.linalg.norm(fitted, axis=1, keepdims=True)
        found = np.asarray(np.isfinite(fitted).all(axis=1))
        normals = np.asarray(np.where(found[:, None], fitted, normals))
    middle = surface_heights(
        model.mesh, positions, normals, np.zeros((1, 2)), _RAY_REACH
    )
    positions = positions + np.nan_to_num(middle) * normals
    seated = found & ((start * normals).sum(axis=1) > np.cos(_MAX_REFIT))
    return positions, normals, np.asarray(seated & np.isfinite(middle[:, 0]))


def _accessible(
    model: ObjectModel, cup: SuctionCup, positions: Array, normals: Array
) -> NDArray[np.bool_]:
    """Whether the tool reaches a point, for instance not inside a ring, (N,)."""
    bore = np.concatenate([_ring(cup.lip_radius), np.zeros((1, 2))])
    heights = surface_heights(model.mesh, positions, normals, bore, cup.length)
    return np.asarray((np.nan_to_num(heights, nan=-1.0) < _OVERHANG).all(axis=1))


def _leverage(
    model: ObjectModel, cup: SuctionCup, positions: Array, normals: Array
) -> Array:
    """How much of the lip's moment limit the weight leaves, 0..1.

    A ring that is pressed on with a force F keeps contact all around under moments up
    to F r / 2 (the core of a ring).
    """
    to_com = model.center_of_mass - positions
    arm = np.linalg.norm(np.cross(to_com, normals), axis=1)
    weight = _GRAVITY * model.mass
    preload = max(cup.holding_force - weight, 1e-6)
    return np.asarray(np.maximum(1 - weight * arm / (preload * cup.lip_radius / 2), 0))


def _margin(
    model: ObjectModel, cup: SuctionCup, positions: Array, normals: Array
) -> Array:
    """0.3 at an edge to 1 where rings up to the wished margin still lie on the surface.

    A wider ring on a curved surface falls away from the plane, so that only the part
    beyond what a sphere or cylinder through the lip would give counts as an edge.
    """
    radii = cup.lip_radius + cup.margin * np.arange(_MARGIN_STEPS + 1) / _MARGIN_STEPS
    pattern = np.concatenate([_ring(radius) for radius in radii])
    heights = surface_heights(model.mesh, positions, normals, pattern, _RAY_REACH)
    rings = heights.reshape(len(positions), len(radii), _RING_RAYS)
    expected = rings[:, :1] * (radii[:, None] / cup.lip_radius) ** 2
    lies_on = (np.abs(rings - expected) < 2 * cup.conformity).all(axis=2)
    # How many rings do, from the lip outward; the lip itself is the first.
    held = np.cumprod(lies_on, axis=1).sum(axis=1) - 1
    return np.asarray(0.3 + 0.7 * (held / _MARGIN_STEPS))


def _spread(
    positions: Array, normals: Array, quality: Array, spacing: float
) -> list[int]:
    """Indices of points, best first, none near a better one that faces the same way."""
    chosen: list[int] = []
    for n in np.lexsort((np.arange(len(quality)), -np.round(quality, 9))):
        if quality[n] <= 0:
            break
        near = np.linalg.norm(positions[chosen] - positions[n], axis=1) < spacing
        if not (near & (normals[chosen] @ normals[n] > _SAME_SIDE)).any():
            chosen.append(int(n))
    return chosen
