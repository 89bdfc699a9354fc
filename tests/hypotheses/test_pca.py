# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from physim_drake.hypotheses.pca import pca_poses
from physim_drake.observation.observation import Detection, Segment
from physim_drake.poses import (
    Array,
    is_rotation,
    make_pose,
    rotation_angle,
    transform_points,
)
from tests.synthetic import ERASER, GLUE, library, pose_error


def segment_of(points: Array) -> Segment:
    none = np.zeros((1, 1), dtype=bool)
    return Segment(Detection(1, np.zeros(4)), points, np.zeros_like(points), none)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31))
def test_one_of_the_poses_of_a_whole_surface_is_right(seed: int) -> None:
    generator = np.random.default_rng(seed)
    X_SO = make_pose(
        Rotation.random(rng=generator).as_matrix(), generator.uniform(-1, 1, 3)
    )
    model = library()[GLUE]
    points, _ = model.surface_sample(2000, seed=3)
    poses = pca_poses(model, segment_of(transform_points(X_SO, points)))
    assert all(is_rotation(X[:3, :3], 1e-9) for X in poses)
    errors = [pose_error(X, X_SO, model.symmetry) for X in poses]
    shift, turn = min(errors, key=lambda error: error[1])
    assert shift < 3
    assert turn < 5


def test_the_four_poses_differ_by_half_turns() -> None:
    points, _ = library()[ERASER].surface_sample(500)
    poses = pca_poses(library()[ERASER], segment_of(points))
    assert poses.shape == (4, 4, 4)
    for X in poses:
        # The eraser is a box: each of them is one of its symmetries.
        shift, turn = pose_error(X, np.eye(4), library()[ERASER].symmetry)
        assert shift < 2
        assert turn < 5
    relative = poses[0, :3, :3].T @ poses[1:, :3, :3]
    np.testing.assert_allclose(rotation_angle(relative), np.pi, atol=1e-6)
