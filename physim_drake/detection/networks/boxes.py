# SPDX-License-Identifier: MIT
"""Boxes as tensors (N, 4): left, top, right, bottom in pixels.

Overlap, the regression code of Faster R-CNN, and non-maximum suppression.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

# A box grows by at most this factor in one regression step.
_MAX_LOG_GROWTH = math.log(1000.0 / 16)


def areas(boxes: Tensor) -> Tensor:
    """Areas (N,), px^2."""
    return (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])


def pairwise_iou(a: Tensor, b: Tensor) -> Tensor:
    """Intersection over union (N, M) of boxes (N, 4) and (M, 4)."""
    corner = torch.maximum(a[:, None, :2], b[None, :, :2])
    size = (torch.minimum(a[:, None, 2:], b[None, :, 2:]) - corner).clamp(min=0)
    shared = size[..., 0] * size[..., 1]
    union = areas(a)[:, None] + areas(b)[None] - shared
    return torch.where(union > 0, shared / union, torch.zeros_like(shared))


def encode_boxes(
    boxes: Tensor, reference: Tensor, scale: tuple[float, float] = (1.0, 1.0)
) -> Tensor:
    """How to shift and stretch reference boxes into others.

    Args:
        boxes: (N, 4).
        reference: (N, 4), of positive size.
        scale: factors of shifts and of logarithmic stretches.

    Returns:
        (N, 4): shift of the centre by the reference's size, logarithm of the growth
        (Girshick et al., "Rich feature hierarchies", CVPR 2014, appendix C).
    """
    center, size = _center_size(boxes)
    center_r, size_r = _center_size(reference)
    shift = (center - center_r) / size_r * scale[0]
    return torch.cat([shift, torch.log(size / size_r) * scale[1]], dim=1)


def decode_boxes(
    code: Tensor, reference: Tensor, scale: tuple[float, float] = (1.0, 1.0)
) -> Tensor:
    """Boxes (N, 4) from what `encode_boxes` gives. Growth is limited to 62 times."""
    center_r, size_r = _center_size(reference)
    center = center_r + code[:, :2] / scale[0] * size_r
    size = size_r * torch.exp((code[:, 2:] / scale[1]).clamp(max=_MAX_LOG_GROWTH))
    return torch.cat([center - size / 2, center + size / 2], dim=1)


def clip_boxes(boxes: Tensor, height: int, width: int) -> Tensor:
    """The parts of boxes (N, 4) inside an image."""
    limit = boxes.new_tensor([width, height, width, height])
    return torch.minimum(boxes.clamp(min=0), limit)


def large_boxes(boxes: Tensor, least: float) -> Tensor:
    """Indices of boxes with both sides at least this long, px."""
    size = boxes[:, 2:] - boxes[:, :2]
    return torch.nonzero((size >= least).all(dim=1)).flatten()


def suppress(boxes: Tensor, scores: Tensor, max_iou: float) -> Tensor:
    """Non-maximum suppression: drops boxes that overlap one of a better score.

    Instead of one box after the other, all are judged at once by those kept so far.
    The first k are right after k rounds, and what no longer changes is the greedy
    answer. A few rounds are enough.

    Args:
        boxes: (N, 4).
        scores: (N,).
        max_iou: overlap above which a box is suppressed.

    Returns:
        indices of those kept, best first.
    """
    order = torch.argsort(scores, descending=True, stable=True)
    sorted_boxes = boxes[order]
    suppresses = (pairwise_iou(sorted_boxes, sorted_boxes) > max_iou).triu(diagonal=1)
    keep = torch.ones(len(order), dtype=torch.bool, device=boxes.device)
    while True:
        judged = ~(suppresses & keep[:, None]).any(dim=0)
        if torch.equal(judged, keep):
            return order[keep]
        keep = judged


def suppress_by_group(
    boxes: Tensor, scores: Tensor, groups: Tensor, max_iou: float
) -> Tensor:
    """As `suppress`, but only boxes of one group (N,) suppress each other."""
    if len(boxes) == 0:
        return torch.zeros(0, dtype=torch.int64, device=boxes.device)
    # Boxes of different groups are moved apart.
    span = boxes.max() - boxes.min() + 1
    return suppress(boxes + (groups * span)[:, None], scores, max_iou)


def _center_size(boxes: Tensor) -> tuple[Tensor, Tensor]:
    return (boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]
