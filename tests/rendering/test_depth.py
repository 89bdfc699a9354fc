# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physim_drake.camera import CameraIntrinsics
from physim_drake.poses import Array, inverse, make_pose
from physim_drake.rendering.depth import DepthRenderer
from tests.synthetic import BALL, CAMERA, TISSUES, library, renderer

OFF_CENTRE = CameraIntrinsics(200, 160, 250.0, 240.0, 80.25, 90.75)


def box_depth(camera: CameraIntrinsics, X_CO: Array, half: Array) -> Array:
    """Depth of a box by casting rays through the middles of pixels; 0 beside it."""
    X_OC = inverse(X_CO)
    rays = camera.rays() @ X_OC[:3, :3].T
    with np.errstate(divide="ignore"):
        bounds = (np.stack([-half, half]) - X_OC[:3, 3])[:, None, None] / rays
    near = bounds.min(axis=0).max(axis=-1)
    far = bounds.max(axis=0).min(axis=-1)
    return np.asarray(np.where(near < far, near, 0.0))


def sphere_depth(camera: CameraIntrinsics, centre: Array, radius: float) -> Array:
    rays = camera.rays()
    a = (rays**2).sum(axis=-1)
    b = rays @ centre
    inside = b**2 - a * (centre @ centre - radius**2)
    return np.asarray(np.where(inside > 0, (b - np.sqrt(np.abs(inside))) / a, 0.0))


@pytest.mark.parametrize("camera", [CAMERA, OFF_CENTRE], ids=["centred", "off centre"])
def test_a_ball_is_where_rays_meet_it(camera: CameraIntrinsics) -> None:
    centre = np.array([0.04, -0.05, 0.5])
    image = renderer(camera).render(BALL, make_pose(p=centre))
    true = sphere_depth(camera, centre, 0.035)
    both = (image > 0) & (true > 0)
    assert np.count_nonzero((image > 0) != (true > 0)) < 0.02 * np.count_nonzero(both)
    # Grazing rays see the facets of the mesh.
    interior = sphere_depth(camera, centre, 0.033) > 0
    np.testing.assert_allclose(image[interior], true[interior], atol=4e-4)


@pytest.mark.parametrize("seed", range(3))
def test_a_box_is_where_rays_meet_it(seed: int) -> None:
    R = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    X_CO = make_pose(R, [-0.03, 0.05, 0.6])
    image = renderer().render(TISSUES, X_CO)
    true = box_depth(CAMERA, X_CO, library()[TISSUES].extents / 2)
    both = (image > 0) & (true > 0)
    # Its edges are bevelled.
    assert np.count_nonzero((image > 0) != (true > 0)) < 0.04 * np.count_nonzero(both)
    errors = np.abs(image - true)[both]
    assert np.percentile(errors, 90) < 1e-4


def test_the_image_moves_with_the_pose_to_a_fraction_of_a_pixel() -> None:
    for p_C in ([0.0, 0.0, 0.5], [0.1, 0.05, 0.6], [-0.12, -0.08, 0.7]):
        image = renderer().render(BALL, make_pose(p=p_C))
        rows, columns = np.nonzero(image)
        u, v = CAMERA.project(np.array(p_C))
        # A sphere off the axis is drawn as an ellipse, a little farther out.
        assert [columns.mean(), rows.mean()] == pytest.approx([u, v], abs=0.8)


def test_only_the_asked_object_is_drawn() -> None:
    X_CO = make_pose(p=[0.0, 0.0, 0.5])
    both = DepthRenderer(library(), CAMERA)
    alone = DepthRenderer({BALL: library()[BALL]}, CAMERA)
    np.testing.assert_array_equal(both.render(BALL, X_CO), alone.render(BALL, X_CO))
    assert (both.render(TISSUES, X_CO) > 0).sum() > (both.render(BALL, X_CO) > 0).sum()


@pytest.mark.parametrize("z", [-0.5, 9.0])
def test_nothing_is_drawn_behind_the_camera_or_too_far(z: float) -> None:
    assert not renderer().render(BALL, make_pose(p=[0.0, 0.0, z])).any()


def test_drawing_is_repeatable_and_the_images_are_separate() -> None:
    X_CO = make_pose(p=[0.01, 0.0, 0.5])
    first = renderer().render(BALL, X_CO)
    kept = first.copy()
    renderer().render(TISSUES, X_CO)
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_array_equal(renderer().render(BALL, X_CO), kept)
    assert first.dtype == np.float32
    assert first.shape == (CAMERA.height, CAMERA.width)
