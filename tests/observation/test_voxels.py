# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np

from physim_drake.observation.voxels import first_in_voxels, voxel_means

POINTS = np.array([[2.5, 0.1, 0.0], [0.2, 0.0, 0.0], [0.4, 0.8, 0.0], [-0.1, 0.0, 0.0]])


def test_the_first_point_of_each_voxel_stays_in_its_place() -> None:
    np.testing.assert_array_equal(first_in_voxels(POINTS, 1.0), POINTS[[0, 1, 3]])


def test_the_points_of_each_voxel_become_their_mean() -> None:
    means = voxel_means(POINTS, 1.0)
    np.testing.assert_allclose(
        means[means[:, 0].argsort()], [[-0.1, 0, 0], [0.3, 0.4, 0], [2.5, 0.1, 0]]
    )


def test_no_points_stay_none() -> None:
    none = np.zeros((0, 3))
    assert first_in_voxels(none, 1.0).shape == (0, 3)
    assert voxel_means(none, 1.0).shape == (0, 3)
