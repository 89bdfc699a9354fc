# SPDX-License-Identifier: MIT
"""Shifts an object out of what it penetrates, before physics takes over.

A contact solver turns centimetres of overlap into metres per second. A few
least-squares shifts on the distance fields remove most of it without motion.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from physim_drake.objects.model import ObjectModel
from physim_drake.poses import Array, transform_points
from physim_drake.registration.registration_model import registration_model

_ITERATIONS = 6
_TOLERANCE = 0.0005
_MAX_SHIFT = 0.04


def depenetrate(
    model: ObjectModel, X_SO: Array, placed: Sequence[tuple[ObjectModel, Array]]
) -> Array:
    """Shifts the object by at most 4 cm to where it overlaps nothing by over 0.5 mm.

    Overlap is judged at the surface points of both bodies, and with the plane z = 0.

    Args:
        model: model of the object.
        X_SO: pose of the object, (4, 4).
        placed: models and poses X_SO of the objects that stay.

    Returns:
        the shifted X_SO. Some overlap may remain.
    """
    X = X_SO.copy()
    own = registration_model(model)
    for _ in range(_ITERATIONS):
        points = transform_points(X, own.points)
        depths = [np.maximum(-points[:, 2], 0.0)]
        directions = [np.tile([0.0, 0.0, 1.0], (len(points), 1))]
        for other, X_SP in placed:
            theirs = registration_model(other)
            if np.linalg.norm(X_SP[:3, 3] - X[:3, 3]) > model.diameter + other.diameter:
                continue
            d, g = theirs.distance_field.query_posed(X_SP, points)
            depths.append(np.maximum(-d, 0.0))
            directions.append(g)
            back = transform_points(X_SP, theirs.points)
            d, g = own.distance_field.query_posed(X, back)
            depths.append(np.maximum(-d, 0.0))
            directions.append(-g)
        depth, direction = np.concatenate(depths), np.concatenate(directions)
        if depth.max() < _TOLERANCE:
            break
        # Deep points get more weight: the shift that they need also frees shallow ones.
        weight = depth / depth.max()
        A = np.einsum("n,ni,nj->ij", weight, direction, direction)
        b = (weight * depth) @ direction
        X[:3, 3] += np.linalg.solve(A + 0.02 * np.trace(A) * np.eye(3), b)
        if np.linalg.norm(X[:3, 3] - X_SO[:3, 3]) > _MAX_SHIFT:
            break
    return X
