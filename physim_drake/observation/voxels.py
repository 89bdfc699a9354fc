# SPDX-License-Identifier: MIT
"""Thins clouds of points to one a voxel."""

from __future__ import annotations

import numpy as np

from physim_drake.poses import Array


def first_in_voxels(points: Array, size: float) -> Array:
    """The first of the points (N, 3) in each voxel of `size` (m), in their order."""
    cells = np.floor(points / size).astype(np.int64)
    first = np.unique(cells, axis=0, return_index=True)[1]
    return np.asarray(points[np.sort(first)])


def voxel_means(points: Array, size: float) -> Array:
    """The mean of the points (N, 3) in each voxel of `size` (m), in no set order."""
    cells = np.floor(points / size).astype(np.int64)
    _, inverse, counts = np.unique(
        cells, axis=0, return_inverse=True, return_counts=True
    )
    sums = np.stack(
        [np.bincount(inverse.ravel(), weights=points[:, a]) for a in range(3)], axis=1
    )
    return np.asarray(sums / counts[:, None])
