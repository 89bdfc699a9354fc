# SPDX-License-Identifier: MIT
"""Anchors: the boxes that the region proposal network starts from, and matching.

Both after Ren et al., "Faster R-CNN", NeurIPS 2015, section 3.1.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from physim_drake.detection.networks.boxes import pairwise_iou

BACKGROUND, IGNORED = -1, -2
"""Instead of the index of a true box, if there is no true box or no clear one."""


def level_anchors(
    height: int,
    width: int,
    stride: float,
    sizes: Sequence[float],
    ratios: Sequence[float],
    device: torch.device,
) -> Tensor:
    """Anchors of one feature map.

    Args:
        height: height of the map, cells.
        width: width of the map, cells.
        stride: pixels per cell.
        sizes: square roots of the anchors' areas, px.
        ratios: heights of the anchors by their widths.
        device: device to make them on.

    Returns:
        (height * width * A, 4), row by row. The A = len(sizes) * len(ratios) anchors
        of a cell follow each other and are centred on the cell.
    """
    size = torch.tensor(list(sizes), dtype=torch.float32, device=device)[:, None]
    root = torch.tensor(list(ratios), dtype=torch.float32, device=device).sqrt()[None]
    half = torch.stack([size / root, size * root], dim=-1).reshape(-1, 2) / 2
    y = (torch.arange(height, device=device) + 0.5) * stride
    x = (torch.arange(width, device=device) + 0.5) * stride
    centers = torch.stack(torch.meshgrid(x, y, indexing="xy"), dim=-1)
    centers = centers.reshape(-1, 1, 2)
    return torch.cat([centers - half, centers + half], dim=-1).reshape(-1, 4)


def match(
    reference: Tensor,
    truth: Tensor,
    foreground: float,
    background: float,
    keep_best: bool = False,
) -> Tensor:
    """Which true box each reference box stands for.

    Args:
        reference: anchors or proposals, (N, 4).
        truth: true boxes, (M, 4).
        foreground: overlap from which on a reference box stands for the true box that
            it overlaps most.
        background: overlap below which it does not stand for any true box.
        keep_best: the reference boxes that overlap a true box most stand for it,
            however little that is.

    Returns:
        (N,) index of the true box, `BACKGROUND` or `IGNORED`.
    """
    if len(truth) == 0:
        return torch.full((len(reference),), BACKGROUND, device=reference.device)
    iou = pairwise_iou(reference, truth)
    best, index = iou.max(dim=1)
    matched = torch.where(best >= background, IGNORED, BACKGROUND)
    matched = torch.where(best >= foreground, index, matched)
    if keep_best:
        most = iou.max(dim=0).values
        is_best = ((iou == most) & (most > 0)).any(dim=1)
        matched = torch.where(is_best, index, matched)
    return matched


def sample(matched: Tensor, count: int, positive_share: float) -> tuple[Tensor, Tensor]:
    """Chooses what to learn from, by torch's random numbers.

    Args:
        matched: result of `match`, (N,).
        count: number to choose at most.
        positive_share: largest share of them that stands for true boxes.

    Returns:
        indices of those that stand for true boxes, and of those that do not.
    """
    positive = torch.nonzero(matched >= 0).flatten()
    negative = torch.nonzero(matched == BACKGROUND).flatten()
    positive = _some(positive, int(count * positive_share))
    return positive, _some(negative, count - len(positive))


def _some(indices: Tensor, count: int) -> Tensor:
    # Random numbers come from the CPU, so that all devices choose the same.
    order = torch.randperm(len(indices))[:count]
    return indices[order.to(indices.device)]
