# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from physim_drake.camera import CameraIntrinsics

CAMERA = CameraIntrinsics(64, 48, 55.0, 57.0, 30.25, 22.75)


def test_the_matrix_and_back() -> None:
    assert CameraIntrinsics.from_matrix(CAMERA.K, 64, 48) == CAMERA


def test_project_agrees_with_the_matrix() -> None:
    p_C = np.array([0.1, -0.2, 0.8])
    u, v, w = CAMERA.K @ p_C
    np.testing.assert_allclose(CAMERA.project(p_C), [u / w, v / w])


@given(st.integers(0, 2**31))
def test_a_pixel_projects_back_to_itself(seed: int) -> None:
    depth = np.random.default_rng(seed).uniform(0.3, 3.0, (48, 64)).astype(np.float32)
    p_C = CAMERA.unproject(depth)
    np.testing.assert_allclose(p_C[..., 2], depth)
    columns, rows = np.meshgrid(np.arange(64), np.arange(48))
    np.testing.assert_allclose(
        CAMERA.project(p_C), np.stack([columns, rows], axis=-1), atol=1e-4
    )


def test_the_principal_point_looks_straight_ahead() -> None:
    camera = CameraIntrinsics(64, 48, 55.0, 57.0, 30.0, 22.0)
    np.testing.assert_array_equal(camera.rays()[22, 30], [0, 0, 1])
    right, below = camera.rays()[22, 31], camera.rays()[23, 30]
    assert right[0] > 0
    assert below[1] > 0


def test_nothing_measured_gives_no_point() -> None:
    assert not CAMERA.unproject(np.zeros((48, 64), dtype=np.float32)).any()
