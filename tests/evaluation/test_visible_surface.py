# SPDX-License-Identifier: MIT
"""VSD on spheres, whose depth images have a closed form."""

from __future__ import annotations

import numpy as np
import pytest

from physim_drake.camera import CameraIntrinsics, DepthImage
from physim_drake.evaluation.visible_surface import VSD_TAUS, SceneDistances, vsd

CAMERA = CameraIntrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
RADIUS = 0.1


def sphere(x: float, z: float) -> DepthImage:
    """Depth of a sphere about (x, 0, z)."""
    rays = CAMERA.rays()
    centre = np.array([x, 0.0, z])
    a, b = (rays**2).sum(-1), rays @ centre
    inside = b**2 - a * (centre @ centre - RADIUS**2)
    depth = np.where(inside > 0, (b - np.sqrt(np.maximum(inside, 0))) / a, 0)
    return depth.astype(np.float32)


def errors(measured: DepthImage, estimated: DepthImage) -> np.ndarray:
    scene = SceneDistances.from_depth(measured, CAMERA)
    return vsd(scene, sphere(0, 0.8), estimated, 2 * RADIUS)


def test_the_true_pose_has_no_error() -> None:
    assert (errors(sphere(0, 0.8), sphere(0, 0.8)) == 0).all()


def test_what_lies_apart_is_all_wrong() -> None:
    assert (errors(sphere(0, 0.8), sphere(0.5, 0.8)) == 1).all()


def test_a_shift_along_the_ray_counts_in_diameters() -> None:
    # 0.05 m nearer: a quarter of the diameter, so from tau = 0.3 on all of the shared
    # pixels are right, and only the wider silhouette is wrong.
    found = errors(sphere(0, 0.8), sphere(0, 0.75))
    wider = 1 - (sphere(0, 0.8) > 0).sum() / (sphere(0, 0.75) > 0).sum()
    assert (found[VSD_TAUS < 0.24] > 0.9).all()
    assert found[-1] == pytest.approx(wider)


def test_hidden_parts_do_not_count() -> None:
    # A wall stands before the left half; the estimate is wrong only behind it.
    wall = sphere(0, 0.8)
    wall[:, :32] = 0.3
    estimated = sphere(0, 0.8)
    estimated[:, :28] = 0
    assert (errors(wall, estimated) == 0).all()


def test_unmeasured_pixels_count_as_visible() -> None:
    estimated = sphere(0, 0.8)
    estimated[:, :32] = 0
    found = errors(np.zeros((48, 64), np.float32), estimated)
    assert found == pytest.approx(0.5, abs=0.05)


def test_nothing_visible_is_an_error() -> None:
    wall = np.full((48, 64), 0.1, np.float32)
    assert (errors(wall, sphere(0, 0.8)) == 1).all()
