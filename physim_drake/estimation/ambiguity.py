# SPDX-License-Identifier: MIT
"""What is left of a confidence if other poses explain the image about as well.

How well the image confirms a pose says nothing of others that it would confirm just as
well: the far side of an object is not seen, and a box looks the same from both ends. So
a confidence is shared among the poses that were tried and cost nearly the same.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from physim_drake.objects.model import ObjectModel
from physim_drake.pose_errors import pose_error
from physim_drake.poses import Array
from physim_drake.search.states import Placement

SAME_ANGLE = np.radians(5.0)
SAME_DISTANCE = 0.01
"""Poses of an object within both of these (rad, m) are one pose."""

_NEGLIGIBLE = 1e-3  # of a confidence


def confidence_shares(
    best: Placement,
    cost: float,
    tried: Sequence[tuple[Placement, float]],
    models: Mapping[int, ObjectModel],
    tie_fraction: float,
) -> dict[int, float]:
    """The share of its confidence that each object keeps.

    An object keeps 1 / (1 + sum of exp(-gap / scale)), a term for each other pose of
    it that was tried: `gap` is by how much the best state with that pose costs more
    than the estimate, and `scale` a tie's share of the estimate's cost.

    Args:
        best: the state that is the estimate.
        cost: fine cost, in pixels.
        tried: states of the same objects, maybe with `best`, and their fine costs.
        models: models of the objects, by their index in the scene.
        tie_fraction: costs that differ by less than this share are equally good.

    Returns:
        the shares by index, 1 if no other pose of the object is as good.
    """
    weighed = [
        (state, weight)
        for state, other in sorted(tried, key=lambda item: item[1])
        if (weight := _weight(other - cost, tie_fraction * cost)) > _NEGLIGIBLE
    ]
    return {k: 1 / (1 + _others(k, best, weighed, models)) for k in best}


def _weight(gap: float, scale: float) -> float:
    """How much a state counts beside the estimate, 0..1.

    One that costs less, by no more than a tie since it was not taken, counts as if it
    cost the same.
    """
    if gap <= 0:
        return 1.0
    return math.exp(-gap / scale) if scale > 0 else 0.0


def _others(
    index: int,
    best: Placement,
    weighed: Sequence[tuple[Placement, float]],
    models: Mapping[int, ObjectModel],
) -> float:
    """The weights of an object's other poses, each pose counted once.

    A pose that another object of its kind has in the estimate does not count: the two
    have merely changed places.
    """
    model = models[index]
    known = [X for k, X in best.items() if models[k].object_id == model.object_id]
    total = 0.0
    for state, weight in weighed:
        if not any(same_pose(model, X_SO, state[index]) for X_SO in known):
            known.append(state[index])
            total += weight
    return total


def same_pose(model: ObjectModel, X_SA: Array, X_SB: Array) -> bool:
    """Whether two poses of an object are one, but for its symmetry."""
    error = pose_error(X_SA, X_SB, model.symmetry)
    return error.within(SAME_ANGLE, SAME_DISTANCE)
