# SPDX-License-Identifier: MIT
"""The head that classifies every pixel from a map of features.

It is all of `FullyConvolutionalNetwork` but its features. In `FasterRcnn` it helps in
training, since every pixel has something to teach, while boxes are few (Chen et al.,
"Hybrid Task Cascade", CVPR 2019, gain by the same).
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from physim_drake.detection.networks.backbones import STRIDES
from physim_drake.detection.networks.image_batch import ImageBatch, Target

_STRIDE = STRIDES[0]
_NO_PIXEL = -1


class PixelHead(nn.Module):
    """Two convolutions, then scores of all classes in every cell.

    Args:
        channels: channels of the map.
        classes: number of classes, without background.

    Attributes:
        classes: number of classes, without background.
    """

    def __init__(self, channels: int, classes: int) -> None:
        super().__init__()
        self.classes = classes
        self.layers = nn.Sequential(
            nn.Conv2d(channels, channels, 3, padding=1),
            nn.ReLU(inplace=True),
            nn.Conv2d(channels, classes + 1, 1),
        )

    def forward(self, finest: Tensor) -> Tensor:
        """Scores (B, classes + 1, h, w) of the pyramid's finest map (B, C, h, w)."""
        scores: Tensor = self.layers(finest).float()
        return scores


def pixel_loss(scores: Tensor, targets: Sequence[Target], batch: ImageBatch) -> Tensor:
    """How wrong the scores of a `PixelHead` are, at the centre of each cell."""
    goals = torch.full(
        (scores.shape[0], *scores.shape[2:]), _NO_PIXEL, device=scores.device
    )
    for k, size in enumerate(batch.sizes):
        center = _STRIDE // 2
        cells = class_map(targets[k], size)[center::_STRIDE, center::_STRIDE]
        goals[k, : cells.shape[0], : cells.shape[1]] = cells
    return functional.cross_entropy(scores, goals, ignore_index=_NO_PIXEL)


def class_map(target: Target, size: tuple[int, int]) -> Tensor:
    """The class of each pixel (height, width) of an image of this size, 0 for none."""
    masks, labels = target["masks"], target["labels"]
    classes = torch.zeros(masks.shape[1:], dtype=torch.int64, device=masks.device)
    for mask, label in zip(masks, labels, strict=True):
        classes[mask > 0] = label
    if tuple(classes.shape) == tuple(size):
        return classes
    scaled = functional.interpolate(classes[None, None].float(), size, mode="nearest")
    return scaled[0, 0].to(torch.int64)
