# SPDX-License-Identifier: MIT
"""RoIAlign over a feature pyramid: the features inside boxes, on a fixed grid.

He et al., "Mask R-CNN", ICCV 2017, section 3. Levels by the size of the box as in Lin
et al., "Feature Pyramid Networks", CVPR 2017, equation 1.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

_SAMPLES = 2  # a side and cell


def pyramid_levels(boxes: Tensor, count: int, finest: float) -> Tensor:
    """The level (N,) of a pyramid that boxes (N, 4) are read from.

    Args:
        boxes: boxes, px.
        count: number of levels, each of half the resolution.
        finest: size (root of the area, px) up to which boxes belong to level 0. Up to
            twice the size they belong to level 1, and so on.
    """
    size = (boxes[:, 2:] - boxes[:, :2]).clamp(min=0).prod(dim=1).sqrt()
    # A box of exactly the limit stays below it whatever rounding does.
    level = torch.ceil(torch.log2(size.clamp(min=1e-6) / finest) - 1e-4)
    return level.clamp(0, count - 1).to(torch.int64)


def roi_align(
    features: Sequence[Tensor],
    strides: Sequence[int],
    boxes: Tensor,
    images: Tensor,
    levels: Tensor,
    size: int,
) -> Tensor:
    """Reads features inside boxes, bilinearly, 2 x 2 samples a cell.

    The value of a feature cell holds at its centre. Beyond the outermost centres the
    nearest one holds.

    Args:
        features: maps (B, C, height, width) of each level.
        strides: pixels per cell of each level.
        boxes: (N, 4), px.
        images: index of the image that each box belongs to, (N,).
        levels: level that each box is read from, (N,).
        size: cells along each side of the grid.

    Returns:
        (N, C, size, size).
    """
    channels = features[0].shape[1]
    # A sum of few rows of a large table with given weights is what embedding bags
    # are. They are many times faster than indexing, above all backwards.
    table = torch.cat([f.permute(0, 2, 3, 1).reshape(-1, channels) for f in features])
    rows = [f.shape[0] * f.shape[2] * f.shape[3] for f in features]
    device = boxes.device
    height = torch.tensor([f.shape[2] for f in features], device=device)[levels]
    width = torch.tensor([f.shape[3] for f in features], device=device)[levels]
    start = torch.tensor([sum(rows[:k]) for k in range(len(rows))], device=device)
    first = start[levels] + images * height * width
    scaled = boxes / torch.tensor(strides, device=device)[levels, None]
    x, x_weight = _interpolation(scaled[:, 0], scaled[:, 2], width, size)
    y, y_weight = _interpolation(scaled[:, 1], scaled[:, 3], height, size)
    # Dimensions: box, row of the grid, column, term along y, term along x.
    index = y[:, :, None, :, None] * width[:, None, None, None, None]
    index = first[:, None, None, None, None] + index + x[:, None, :, None, :]
    weight = y_weight[:, :, None, :, None] * x_weight[:, None, :, None, :]
    terms = (2 * _SAMPLES) ** 2
    read = functional.embedding_bag(
        index.reshape(-1, terms),
        table,
        per_sample_weights=weight.reshape(-1, terms).to(table.dtype),
        mode="sum",
    )
    return read.view(-1, size, size, channels).permute(0, 3, 1, 2)


def _interpolation(
    low: Tensor, high: Tensor, limit: Tensor, size: int
) -> tuple[Tensor, Tensor]:
    """Along one axis: which cells the mean of each grid cell sums, with which weights.

    Both are (N, size, 2 * samples).
    """
    count = size * _SAMPLES
    share = (torch.arange(count, device=low.device) + 0.5) / count
    at = low[:, None] + (high - low)[:, None] * share - 0.5
    last = (limit - 1)[:, None].to(at.dtype)
    at = torch.minimum(at.clamp(min=0), last)
    lower = at.floor()
    cells = torch.stack([lower, torch.minimum(lower + 1, last)], dim=-1).long()
    weights = torch.stack([lower + 1 - at, at - lower], dim=-1) / _SAMPLES
    shape = (len(low), size, 2 * _SAMPLES)
    return cells.view(shape), weights.view(shape)
