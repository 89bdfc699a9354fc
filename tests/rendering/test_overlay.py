# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from physim_drake.camera import CameraIntrinsics
from physim_drake.errors import InputError
from physim_drake.objects.model import ObjectModel
from physim_drake.observation.observation import RgbdObservation
from physim_drake.observation.support_surface import SupportSurface
from physim_drake.poses import make_pose
from physim_drake.rendering.depth import DepthRenderer
from physim_drake.rendering.overlay import draw_overlay, write_png
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate

CAMERA = CameraIntrinsics(320, 240, 300.0, 300.0, 159.5, 119.5)
X_CO = make_pose(p=[0.0, 0.0, 0.5])
GREY = 100


@pytest.fixture(scope="module")
def library() -> dict[int, ObjectModel]:
    cube = trimesh.creation.box([0.1, 0.1, 0.1])
    return {1: ObjectModel.from_mesh(1, "cube", cube)}


@pytest.fixture(scope="module")
def renderer(library: dict[int, ObjectModel]) -> DepthRenderer:
    return DepthRenderer(library, CAMERA)


def observed(renderer: DepthRenderer, offset: float = 0.0) -> RgbdObservation:
    """The cube, measured farther by `offset` metres, on grey."""
    depth = renderer.render(1, X_CO)
    depth[depth > 0] += np.float32(offset)
    depth[:10] = 2.0
    color = np.full((240, 320, 3), GREY, np.uint8)
    return RgbdObservation(depth, CAMERA, color)


def estimated(*objects: ObjectEstimate) -> SceneEstimate:
    surface = SupportSurface(np.eye(4), np.eye(4))
    return SceneEstimate(objects, surface, "pca-icp", {})


CUBE = ObjectEstimate(1, "cube", X_CO, X_CO, 0.87, "")
LOST = ObjectEstimate(1, "cube", None, None, 0.0, "its segment has 0 points")


def test_an_object_is_tinted_and_the_rest_is_left(
    renderer: DepthRenderer, library: dict[int, ObjectModel]
) -> None:
    image = draw_overlay(observed(renderer), estimated(CUBE), library, renderer)
    assert image.shape == (240, 640, 3)
    assert image.dtype == np.uint8
    left = image[:, :320]
    inside = left[140, 160].astype(int)
    assert inside[2] > inside[0] + 30  # the first colour is blue
    assert (left[220:, :40] == GREY).all()


@pytest.mark.parametrize(
    ("offset", "brightest"), [(0.015, "blue"), (-0.015, "red"), (0.0, "none")]
)
def test_residuals_have_the_sign_of_rendered_minus_measured(
    renderer: DepthRenderer,
    library: dict[int, ObjectModel],
    offset: float,
    brightest: str,
) -> None:
    seen = observed(renderer, offset)
    image = draw_overlay(seen, estimated(CUBE), library, renderer)
    red, _, blue = image[120, 320 + 160].astype(int)
    if brightest == "none":
        assert min(red, blue) > 235
    else:
        assert (blue - red if brightest == "blue" else red - blue) > 60


def test_unmeasured_pixels_are_dark(
    renderer: DepthRenderer, library: dict[int, ObjectModel]
) -> None:
    seen = observed(renderer)
    seen.depth[120, 160] = 0.0
    image = draw_overlay(seen, estimated(CUBE), library, renderer)
    assert image[120, 480].max() < 60


def test_nothing_found_leaves_the_colour_image(
    renderer: DepthRenderer, library: dict[int, ObjectModel]
) -> None:
    seen = observed(renderer)
    image = draw_overlay(seen, estimated(LOST), library, renderer)
    assert (image[:, :320] == GREY).all()


def test_without_colour_and_without_a_renderer(
    renderer: DepthRenderer, library: dict[int, ObjectModel]
) -> None:
    seen = RgbdObservation(observed(renderer).depth, CAMERA)
    image = draw_overlay(seen, estimated(CUBE), library)
    again = draw_overlay(seen, estimated(CUBE), library, renderer)
    np.testing.assert_array_equal(image, again)
    assert image[220, 20].tolist() == [0, 0, 0]


def test_names_do_not_cover_each_other(
    renderer: DepthRenderer, library: dict[int, ObjectModel]
) -> None:
    def at(x: float, y: float = 0.0) -> ObjectEstimate:
        return ObjectEstimate(1, "cube", make_pose(p=[x, y, 0.5]), X_CO, 0.5, "")

    def black_rows(*objects: ObjectEstimate) -> int:
        image = draw_overlay(observed(renderer), estimated(*objects), library, renderer)
        return int((image[:, :320] == 0).all(axis=2).any(axis=1).sum())

    alone = black_rows(at(0.0))
    assert black_rows(at(0.0), at(0.0, -0.01)) >= 2 * alone - 1  # above each other
    assert black_rows(at(0.0), at(0.12)) == alone  # beside each other


def test_write_png(tmp_path: Path) -> None:
    image = np.zeros((4, 5, 3), np.uint8)
    image[..., 0] = 200  # red
    write_png(tmp_path / "a.png", image)
    assert cv2.imread(str(tmp_path / "a.png"))[0, 0].tolist() == [0, 0, 200]
    with pytest.raises(InputError, match="cannot be written"):
        write_png(tmp_path / "none" / "a.png", image)
