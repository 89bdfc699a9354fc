# SPDX-License-Identifier: MIT
from __future__ import annotations

import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from physim_drake.detection.networks.boxes import (
    areas,
    clip_boxes,
    decode_boxes,
    encode_boxes,
    large_boxes,
    pairwise_iou,
    suppress,
    suppress_by_group,
)


@st.composite
def box_sets(draw: st.DrawFn, most: int = 12) -> Tensor:
    side = st.floats(1.0, 60.0, width=32)
    corner = st.floats(-20.0, 80.0, width=32)
    rows = draw(st.lists(st.tuples(corner, corner, side, side), max_size=most))
    values = torch.tensor(rows, dtype=torch.float32).reshape(-1, 4)
    return torch.cat([values[:, :2], values[:, :2] + values[:, 2:]], dim=1)


def test_overlap_of_known_boxes():
    a = torch.tensor([[0.0, 0.0, 2.0, 2.0]])
    b = torch.tensor([[1.0, 1.0, 3.0, 3.0], [2.0, 0.0, 4.0, 2.0], [0.0, 0.0, 2.0, 2.0]])
    torch.testing.assert_close(pairwise_iou(a, b), torch.tensor([[1 / 7, 0.0, 1.0]]))


def test_overlap_of_empty_boxes_is_zero():
    empty = torch.zeros(1, 4)
    assert pairwise_iou(empty, empty).item() == 0.0


@given(a=box_sets(), b=box_sets())
def test_overlap_is_symmetric_and_a_share(a: Tensor, b: Tensor):
    iou = pairwise_iou(a, b)
    torch.testing.assert_close(iou, pairwise_iou(b, a).T)
    assert ((iou >= 0) & (iou <= 1 + 1e-5)).all()


def test_code_of_a_known_box():
    reference = torch.tensor([[0.0, 0.0, 10.0, 20.0]])
    box = torch.tensor([[5.0, 5.0, 25.0, 25.0]])  # centre 15, 15; size 20, 20
    code = encode_boxes(box, reference, (10.0, 5.0))
    expected = torch.tensor([[10.0, 2.5, 5 * torch.log(torch.tensor(2.0)), 0.0]])
    torch.testing.assert_close(code, expected)


@given(boxes=box_sets(), data=st.data())
def test_codes_can_be_read_back(boxes: Tensor, data: st.DataObject):
    reference = data.draw(box_sets(most=1).filter(len)).expand(len(boxes), 4)
    code = encode_boxes(boxes, reference, (10.0, 5.0))
    back = decode_boxes(code, reference, (10.0, 5.0))
    torch.testing.assert_close(back, boxes, atol=1e-2, rtol=1e-4)


def test_growth_is_limited():
    reference = torch.tensor([[0.0, 0.0, 1.0, 1.0]])
    box = decode_boxes(torch.tensor([[0.0, 0.0, 100.0, 0.0]]), reference)
    assert 60 < (box[0, 2] - box[0, 0]).item() < 65


@given(boxes=box_sets())
def test_clipped_boxes_are_inside(boxes: Tensor):
    clipped = clip_boxes(boxes, 30, 40)
    assert (clipped >= 0).all()
    assert (clipped[:, [0, 2]] <= 40).all()
    assert (clipped[:, [1, 3]] <= 30).all()
    assert (areas(clipped) <= areas(boxes) * (1 + 1e-5) + 1e-3).all()


def test_small_boxes_are_found_by_either_side():
    boxes = torch.tensor([[0.0, 0, 5, 5], [0, 0, 1, 9], [0, 0, 9, 1], [0, 0, 2, 2]])
    assert large_boxes(boxes, 2.0).tolist() == [0, 3]


def greedy(boxes: Tensor, scores: Tensor, max_iou: float) -> list[int]:
    """Non-maximum suppression as it is written in textbooks."""
    kept: list[int] = []
    for index in torch.argsort(scores, descending=True, stable=True).tolist():
        overlaps = pairwise_iou(boxes[[index]], boxes[kept])
        if not (overlaps > max_iou).any():
            kept.append(index)
    return kept


@given(boxes=box_sets(most=30), seed=st.integers(0, 1000), max_iou=st.floats(0.0, 0.9))
def test_suppression_is_the_greedy_one(boxes: Tensor, seed: int, max_iou: float):
    generator = torch.Generator().manual_seed(seed)
    scores = torch.rand(len(boxes), generator=generator)
    assert suppress(boxes, scores, max_iou).tolist() == greedy(boxes, scores, max_iou)


def test_a_chain_of_boxes_keeps_every_other_one():
    """Each overlaps the next. The second round must free what the first suppressed."""
    left = torch.arange(9.0)
    zero = torch.zeros(9)
    boxes = torch.stack([left, zero, left + 2.5, zero + 1], dim=1)
    scores = 1 - left / 10
    assert suppress(boxes, scores, 0.4).tolist() == [0, 2, 4, 6, 8]


def test_groups_do_not_suppress_each_other():
    boxes = torch.tensor([[0.0, 0.0, 4.0, 4.0]]).repeat(4, 1)
    scores = torch.tensor([0.1, 0.9, 0.8, 0.7])
    groups = torch.tensor([1, 0, 1, 0])
    assert suppress_by_group(boxes, scores, groups, 0.5).tolist() == [1, 2]


def test_nothing_to_suppress():
    none = torch.zeros(0, 4)
    assert len(suppress_by_group(none, torch.zeros(0), torch.zeros(0), 0.5)) == 0
