# SPDX-License-Identifier: MIT
"""Shifts an object out of what it penetrates, before physics takes over.

A contact solver turns centimetres of overlap into metres per second; a few
least-squares shifts on the distance fields remove most of it at rest.
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
        model: the object.
        X_SO: its pose, (4, 4).
        placed: the objects that stay, with their X_SO.

    Returns:
        the shifted X_SO; what overlap it cannot remove, it leaves.
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
        # Deep points decide: they need the shift, shallow ones come free with it.
        weight = depth / depth.max()
        A = np.einsum("n,ni,nj->ij", weight, direction, direction)
        b = (weight * depth) @ direction
        X[:3, 3] += np.linalg.solve(A + 0.02 * np.trace(A) * np.eye(3), b)
        if np.linalg.norm(X[:3, 3] - X_SO[:3, 3]) > _MAX_SHIFT:
            break
    return X
