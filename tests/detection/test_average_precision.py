# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest

from physim_drake.datasets.bop import mask_bounds
from physim_drake.detection.average_precision import average_precision
from physim_drake.observation.observation import Detection
from tests.detection.scenes import square_mask


def square(object_id: int, left: int, side: int = 20, score: float = 1.0) -> Detection:
    mask = square_mask(left, 10, side)
    return Detection(object_id, mask_bounds(mask), score, mask)


TRUTH = [[square(1, 10), square(2, 50)], [square(1, 30)]]


def test_what_is_right_is_perfect():
    result = average_precision(TRUTH, TRUTH)
    assert result.box == result.mask == result.box_50 == pytest.approx(1.0)
    assert result.box_50_by_object == pytest.approx({1: 1.0, 2: 1.0})
    assert result.recall_50 == 1.0


@pytest.mark.parametrize("found", [[[], []], [[square(1, 90)], []]])
def test_what_is_wrong_is_worth_nothing(found: list[list[Detection]]):
    result = average_precision(found, TRUTH)
    assert result.box_50 == result.mask_50 == result.recall_50 == 0.0


def test_a_box_half_off_counts_at_low_overlaps_only():
    """Shifted by 4 of 20 px: overlap 16 / 24 = 0.67, so four of the ten thresholds."""
    result = average_precision([[square(1, 14)]], [[square(1, 10)]])
    assert result.box_50 == pytest.approx(1.0)
    assert result.box == pytest.approx(0.4)


def test_a_missed_class_halves_the_mean():
    result = average_precision([[square(1, 10)], [square(1, 30)]], TRUTH)
    assert result.box_50 == pytest.approx(0.5)
    assert result.box_50_by_object == pytest.approx({1: 1.0, 2: 0.0})


def test_confident_false_alarms_cost_precision():
    found = [[square(1, 90, score=0.9), square(1, 10, score=0.5)]]
    result = average_precision(found, [[square(1, 10)]])
    assert result.box_50 == pytest.approx(0.5)


def test_masks_are_judged_by_their_pixels():
    hollow = square(1, 10)
    assert hollow.mask is not None
    mask = hollow.mask & ~square_mask(14, 14, 15)
    ring = Detection(1, hollow.box, 1.0, np.asarray(mask))
    result = average_precision([[ring]], [[hollow]])
    assert result.box_50 == pytest.approx(1.0)
    assert result.mask_50 == 0.0
