# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from physim_drake.camera import CameraIntrinsics
from physim_drake.errors import InputError
from physim_drake.observation.observation import Detection, RgbdObservation, Segment
from physim_drake.poses import Array

CAMERA = CameraIntrinsics(8, 6, 10.0, 10.0, 3.5, 2.5)
DEPTH = np.full((6, 8), 0.5, dtype=np.float32)


def with_value(value: float) -> Array:
    depth = DEPTH.copy()
    depth[2, 3] = value
    return depth


def test_a_proper_observation_is_taken() -> None:
    color = np.zeros((6, 8, 3), dtype=np.uint8)
    observation = RgbdObservation(DEPTH, CAMERA, color, np.eye(4), "frame 3")
    assert observation.name == "frame 3"
    assert RgbdObservation(DEPTH, CAMERA).X_WC is None


@pytest.mark.parametrize(
    ("field", "value", "text"),
    [
        ("depth", DEPTH.astype(np.uint16), "uint16.*multiply whole numbers"),
        ("depth", np.zeros((6, 8, 1), dtype=np.float32), "shape"),
        ("depth", DEPTH[:, :7], r"\(6, 7\) pixels"),
        ("depth", with_value(-0.1), "negative"),
        ("depth", 0 * DEPTH, "zero everywhere"),
        ("color", np.zeros((6, 7, 3), dtype=np.uint8), "register colour"),
        ("color", np.zeros((6, 8), dtype=np.uint8), "register colour"),
        ("X_WC", np.diag([1.0, 1.0, -1.0, 1.0]), "right-handed"),
        ("X_WC", np.diag([2.0, 2.0, 2.0, 1.0]), "orthonormal"),
        ("X_WC", np.eye(4) * np.nan, "orthonormal"),
        ("X_WC", np.eye(3), "4 x 4"),
        ("X_WC", np.eye(4)[:3], "4 x 4"),
        ("intrinsics", replace(CAMERA, fx=0.0), "fx, fy, cx, cy"),
        ("intrinsics", replace(CAMERA, fy=-10.0), "fx, fy, cx, cy"),
        ("intrinsics", replace(CAMERA, cx=320.0), "do not fit"),
    ],
)
def test_what_cannot_be_right_is_refused(field: str, value: Any, text: str) -> None:
    good: dict[str, Any] = {"depth": DEPTH, "intrinsics": CAMERA, "name": "frame 3"}
    with pytest.raises(InputError, match=text) as caught:
        RgbdObservation(**(good | {field: value}))
    assert caught.value.field == field
    assert str(caught.value).startswith("frame 3: ")


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_was_not_measured(value: float) -> None:
    depth = RgbdObservation(with_value(value), CAMERA).depth
    np.testing.assert_array_equal(depth, with_value(0.0))


def test_depth_of_another_floating_type_is_converted() -> None:
    depth = RgbdObservation(DEPTH.astype(float), CAMERA).depth
    assert depth.dtype == np.float32
    assert RgbdObservation(DEPTH, CAMERA).depth is DEPTH


def test_a_camera_matrix_stands_for_the_intrinsics() -> None:
    observation = RgbdObservation(DEPTH, CAMERA.K)  # type: ignore[arg-type]
    assert observation.intrinsics == CAMERA


def test_a_box_excludes_its_right_and_bottom() -> None:
    pixels = Detection(1, np.array([2.0, 1.0, 4.0, 2.0])).pixels(6, 8)
    assert np.argwhere(pixels).tolist() == [[1, 2], [1, 3]]


@pytest.mark.parametrize(
    ("box", "count"),
    [([-5, -5, 100, 100], 48), ([20, 20, 30, 30], 0), ([3, 3, 3, 3], 0)],
)
def test_a_box_may_reach_beyond_the_image(box: list[float], count: int) -> None:
    assert Detection(1, np.array(box)).pixels(6, 8).sum() == count


def test_a_mask_goes_before_the_box() -> None:
    mask = np.zeros((6, 8), dtype=bool)
    mask[5, 7] = True
    detection = Detection(1, np.array([0.0, 0.0, 2.0, 2.0]), mask=mask)
    np.testing.assert_array_equal(detection.pixels(6, 8), mask)


def test_a_segment_knows_its_object() -> None:
    none = np.zeros((0, 3))
    segment = Segment(Detection(7, np.zeros(4)), none, none, np.zeros((6, 8), bool))
    assert segment.object_id == 7


@pytest.mark.parametrize("box", [[300, 20, 60, 80], [30, 200, 60, 80]])
def test_a_box_of_x_y_width_height_is_refused(box: list[float]) -> None:
    with pytest.raises(InputError, match=r"x \+ width, y \+ height"):
        Detection(1, box)
