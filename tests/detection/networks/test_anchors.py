# SPDX-License-Identifier: MIT
from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from physim_drake.detection.networks.anchors import (
    BACKGROUND,
    IGNORED,
    level_anchors,
    match,
    sample,
)
from physim_drake.detection.networks.boxes import areas

CPU = torch.device("cpu")


def test_anchors_of_a_small_map():
    anchors = level_anchors(1, 2, 8, [16.0], [1.0, 4.0], CPU)
    expected = [
        [-4, -4, 12, 12],  # centred on (4, 4)
        [0, -12, 8, 20],  # four times as high as wide
        [4, -4, 20, 12],
        [8, -12, 16, 20],
    ]
    torch.testing.assert_close(anchors, torch.tensor(expected).float())


@given(
    height=st.integers(1, 5),
    width=st.integers(1, 5),
    stride=st.sampled_from([4, 8, 32]),
)
def test_anchors_have_the_areas_asked_for(height: int, width: int, stride: int):
    anchors = level_anchors(height, width, stride, [10.0, 30.0], [0.5, 1.0, 2.0], CPU)
    assert len(anchors) == height * width * 6
    expected = torch.tensor([100.0] * 3 + [900.0] * 3).repeat(height * width)
    torch.testing.assert_close(areas(anchors), expected, rtol=1e-4, atol=0.0)


def boxes_of_overlap(*overlaps: float) -> torch.Tensor:
    """Boxes that share this part of their union with the square of side 10."""
    return torch.tensor([[0.0, 0.0, 10.0, 10.0 * overlap] for overlap in overlaps])


TRUTH = torch.tensor([[0.0, 0.0, 10.0, 10.0], [50.0, 0.0, 60.0, 10.0]])


def test_matching_by_overlap():
    matched = match(boxes_of_overlap(0.8, 0.5, 0.1), TRUTH, 0.7, 0.3)
    assert matched.tolist() == [0, IGNORED, BACKGROUND]


def test_the_best_anchor_of_a_true_box_is_kept():
    matched = match(boxes_of_overlap(0.2, 0.1), TRUTH, 0.7, 0.3, keep_best=True)
    # The second true box overlaps nothing, and nothing may stand for it.
    assert matched.tolist() == [0, BACKGROUND]


def test_without_true_boxes_all_is_background():
    matched = match(boxes_of_overlap(0.8, 0.1), TRUTH[:0], 0.7, 0.3, keep_best=True)
    assert matched.tolist() == [BACKGROUND, BACKGROUND]


@pytest.mark.parametrize(("positives", "expected"), [(3, (3, 7)), (40, (5, 5))])
def test_samples_are_of_both_kinds(positives: int, expected: tuple[int, int]):
    torch.manual_seed(0)
    matched = torch.tensor([0] * positives + [IGNORED] * 5 + [BACKGROUND] * 50)
    positive, negative = sample(matched, 10, 0.5)
    assert (len(positive), len(negative)) == expected
    assert (matched[positive] >= 0).all()
    assert (matched[negative] == BACKGROUND).all()
    assert len(set(negative.tolist())) == len(negative)
