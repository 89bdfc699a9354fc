# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest

from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.picking.table_detector import TableDetector, middle_points
from physim_drake.picking.tote import Tote
from physim_drake.poses import Array, make_pose
from tests.synthetic import CAMERA

DOWN = np.diag([1.0, -1.0, -1.0])
X_WC = make_pose(DOWN, [0.0, 0.0, 1.0])  # 1 m over the table, x to the right
DEPTH = np.full((240, 320), 1.0, dtype=np.float32)
LEFT, RIGHT = np.array([40.0, 100, 80, 140]), np.array([240.0, 100, 280, 140])
RNG = np.random.default_rng(0)


def look(X: Array | None = X_WC) -> RgbdObservation:
    return RgbdObservation(DEPTH, CAMERA, None, X)


class Fixed:
    def __init__(self, *boxes: Array) -> None:
        self.boxes = boxes

    def detect(
        self, observation: RgbdObservation, labels: object, generator: object
    ) -> tuple[Detection, ...]:
        return tuple(Detection(n, box) for n, box in enumerate(self.boxes))


def tote_at(x: float) -> Tote:
    return Tote(make_pose(p=[x, 0.0, 0.0]), np.array([0.1, 0.3]), np.zeros((1, 3)))


def test_points_lie_where_the_pixels_look() -> None:
    p_W = middle_points(Detection(1, RIGHT), look())
    assert p_W[:, 2] == pytest.approx(0.0, abs=1e-6)
    assert np.median(p_W[:, 0]) == pytest.approx((260 - 159.5) / 300, abs=0.005)
    assert np.median(p_W[:, 1]) == pytest.approx((119.5 - 120) / 300, abs=0.005)


def test_pixels_without_depth_are_no_points() -> None:
    holes = look()
    depth = holes.depth.copy()
    depth[:, 200:] = 0
    dark = RgbdObservation(depth, CAMERA, None, X_WC)
    assert len(middle_points(Detection(1, RIGHT), dark)) == 0
    assert len(middle_points(Detection(1, RIGHT), look(None))) == 0


def test_a_box_beyond_the_image_is_cut() -> None:
    box = np.array([-50.0, -50, 1000, 1000])
    assert len(middle_points(Detection(1, box), look())) > 0


def test_what_lies_in_the_tote_is_not_detected() -> None:
    both = Fixed(LEFT, RIGHT)
    for x, expected in ((0.335, [0]), (-0.33, [1]), (3.0, [0, 1])):
        found = TableDetector(both, tote_at(x)).detect(look(), None, RNG)
        assert [d.object_id for d in found] == expected


def test_the_mask_of_a_detection_says_where_it_is() -> None:
    """A box around a long thing that lies across may have another in its middle."""
    mask = np.zeros(DEPTH.shape, dtype=bool)
    mask[100:140, 250:270] = True
    whole = np.array([0.0, 0, 320, 240])
    p_W = middle_points(Detection(1, whole, 1.0, mask), look())
    assert len(p_W) == 800
    assert p_W[:, 0].min() > (249 - 159.5) / 300
    assert len(middle_points(Detection(1, whole, 1.0, mask), look(None))) == 0


def test_without_depth_the_other_detector_is_believed() -> None:
    blind = RgbdObservation(
        np.where(np.arange(320) < 160, DEPTH, 0), CAMERA, None, X_WC
    )
    found = TableDetector(Fixed(RIGHT), tote_at(0.335)).detect(blind, None, RNG)
    assert len(found) == 1
