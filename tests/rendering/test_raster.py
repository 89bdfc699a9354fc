# SPDX-License-Identifier: MIT
from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from physim_drake.camera import CameraIntrinsics, DepthImage
from physim_drake.objects.model import ObjectModel
from physim_drake.poses import Array, SymmetryGroup, make_pose
from physim_drake.rendering.depth import DepthRenderer
from physim_drake.rendering.raster import DepthRasterizer
from physim_drake.rendering.windows import paste
from tests.synthetic import (
    BALL,
    CAMERA,
    COFFEE,
    GLUE,
    TAPE,
    TISSUES,
    library,
    renderer,
)

OFF_CENTRE = CameraIntrinsics(200, 160, 250.0, 240.0, 80.25, 90.75)


@cache
def rasterizer(camera: CameraIntrinsics = CAMERA) -> DepthRasterizer:
    return DepthRasterizer(library(), camera)


def drawn(object_id: int, X_CO: Array, camera: CameraIntrinsics = CAMERA) -> DepthImage:
    """The whole image."""
    image = np.zeros((camera.height, camera.width), dtype=np.float32)
    paste(image, rasterizer(camera).window(object_id, X_CO))
    return image


@pytest.mark.parametrize("camera", [CAMERA, OFF_CENTRE], ids=["centred", "off centre"])
@pytest.mark.parametrize("object_id", [BALL, COFFEE, GLUE, TAPE, TISSUES])
def test_it_draws_what_drake_draws(object_id: int, camera: CameraIntrinsics) -> None:
    generator = np.random.default_rng(object_id)
    for p in ([0.0, 0.0, 0.5], [0.06, -0.05, 0.7]):
        X_CO = make_pose(Rotation.random(rng=generator).as_matrix(), p)
        own, reference = (
            drawn(object_id, X_CO, camera),
            renderer(camera).render(object_id, X_CO),
        )
        both = (own > 0) & (reference > 0)
        assert both.sum() > 400
        # Pixels of the outline, where rounding decides.
        assert ((own > 0) != (reference > 0)).sum() <= 3
        errors = np.abs(own - reference)[both]
        assert np.percentile(errors, 99.5) < 1e-5
        assert (errors > 1e-3).sum() <= 3


@pytest.mark.parametrize("p", [[0.35, 0.0, 0.6], [-0.3, 0.28, 0.6], [0.0, -0.25, 0.5]])
def test_at_the_border_of_the_image_it_is_cut(p: list[float]) -> None:
    X_CO = make_pose(p=p)
    window = rasterizer().window(TISSUES, X_CO)
    height, width = window.depth.shape
    assert 0 <= window.row <= window.row + height <= CAMERA.height
    assert 0 <= window.column <= window.column + width <= CAMERA.width
    reference = renderer().render(TISSUES, X_CO)
    assert (reference > 0).sum() > 100
    assert ((drawn(TISSUES, X_CO) > 0) != (reference > 0)).sum() <= 3


@pytest.mark.parametrize(
    "p",
    [[0.0, 0.0, -0.5], [0.0, 0.0, 9.0], [3.0, 0.0, 0.5], [0.0, -3.0, 0.5]],
    ids=["behind", "too far", "right", "above"],
)
def test_what_is_out_of_sight_is_not_drawn(p: list[float]) -> None:
    assert not rasterizer().window(BALL, make_pose(p=p)).depth.any()


def test_what_reaches_to_the_camera_is_drawn_as_far_as_it_does_not() -> None:
    window = rasterizer().window(TISSUES, make_pose(p=[0.0, 0.0, 0.1]))
    assert np.isfinite(window.depth).all()
    assert window.depth.max() < 0.5


def test_an_open_surface_is_drawn_from_both_sides() -> None:
    sheet = trimesh.Trimesh(
        [[-0.1, -0.1, 0], [0.1, -0.1, 0], [0.1, 0.1, 0], [-0.1, 0.1, 0]],
        [[0, 1, 2], [0, 2, 3]],
    )
    box = trimesh.creation.box((0.02, 0.02, 0.02))
    box.apply_translation([0.3, 0.0, 0.0])
    both = trimesh.util.concatenate([sheet, box])
    model = ObjectModel.from_mesh(1, "sheet", both, symmetry=SymmetryGroup(), mass=1.0)
    rasterizer = DepthRasterizer({1: model}, CAMERA)
    over = make_pose(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 0.5])
    for X_CO in (make_pose(p=[0.0, 0.0, 0.5]), over):
        depth = rasterizer.window(1, X_CO).depth
        assert (depth > 0).sum() > 10_000
        np.testing.assert_allclose(depth[depth > 0].max(), 0.5, atol=1e-6)


def test_no_pixel_between_two_triangles_is_missed() -> None:
    # A ball of small triangles: a gap would show as a hole.
    image = drawn(BALL, make_pose(p=[0.01, 0.02, 0.3]))
    rows, columns = np.nonzero(image)
    for row in np.unique(rows):
        along = np.sort(columns[rows == row])
        assert (np.diff(along) == 1).all()


def test_it_can_stand_for_the_reference() -> None:
    own, reference = rasterizer(), DepthRenderer({BALL: library()[BALL]}, CAMERA)
    X_CO = make_pose(p=[0.03, 0.0, 0.5])
    a, b = own.window(BALL, X_CO), reference.window(BALL, X_CO)
    assert own.intrinsics == reference.intrinsics
    assert abs(a.row - b.row) <= 1
    assert abs(a.column - b.column) <= 1
