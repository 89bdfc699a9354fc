# SPDX-License-Identifier: MIT
"""The region proposal network, which proposes boxes of objects of any class.

Ren et al., "Faster R-CNN", NeurIPS 2015, section 3.1, on a feature pyramid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from physim_drake.detection.networks.anchors import level_anchors, match, sample
from physim_drake.detection.networks.boxes import (
    clip_boxes,
    decode_boxes,
    encode_boxes,
    large_boxes,
    suppress,
)

FIRST_LEVEL = 1
"""Proposals come from the pyramid's levels from here on: those of strides 8 to 32."""

_SIZES = ((18.0, 30.0), (46.0, 70.0), (110.0, 180.0))  # px, by level
_RATIOS = (0.5, 1.0, 2.0)
_PER_CELL = 6
_FOREGROUND, _BACKGROUND = 0.7, 0.3
_SAMPLES, _POSITIVE_SHARE = 128, 0.5
_BEFORE_SUPPRESSION = 400  # of each level
_MAX_IOU = 0.7
_LEAST_SIZE = 3.0  # px
_BETA = 1.0 / 9  # of the smooth L1 loss


@dataclass(frozen=True)
class Proposals:
    """Boxes that may hold an object.

    Attributes:
        boxes: boxes of each image, (N, 4), px, best first.
        losses: losses by name, empty without targets.
    """

    boxes: list[Tensor]
    losses: dict[str, Tensor]


class RegionProposalNetwork(nn.Module):
    """Scores anchors and moves them onto objects.

    Args:
        channels: channels of the feature maps.
        strides: pixels per cell of each map.
        count: largest number of proposals for an image.
    """

    def __init__(self, channels: int, strides: Sequence[int], count: int = 120) -> None:
        super().__init__()
        self._strides, self._count = tuple(strides), count
        self.hidden = nn.Conv2d(channels, channels, 3, padding=1)
        self.score = nn.Conv2d(channels, _PER_CELL, 1)
        self.shift = nn.Conv2d(channels, _PER_CELL * 4, 1)
        for layer in (self.hidden, self.score, self.shift):
            nn.init.normal_(layer.weight, std=0.01)
            nn.init.zeros_(layer.bias)  # type: ignore[arg-type]

    def forward(
        self,
        maps: Sequence[Tensor],
        sizes: Sequence[tuple[int, int]],
        truth: Sequence[Tensor] | None = None,
    ) -> Proposals:
        """Proposes boxes, and gives the losses if true boxes are known.

        Args:
            maps: maps of the pyramid, (B, channels, height, width).
            sizes: height and width of each image, px.
            truth: true boxes of each image, (N, 4), px.
        """
        scores, codes, anchors = [], [], []
        for x, stride, side in zip(maps, self._strides, _SIZES, strict=True):
            hidden = functional.relu(self.hidden(x))
            scores.append(_by_anchor(self.score(hidden), 1)[..., 0])
            codes.append(_by_anchor(self.shift(hidden), 4))
            height, width = x.shape[2:]
            anchors.append(
                level_anchors(height, width, stride, side, _RATIOS, x.device)
            )
        counts = [len(a) for a in anchors]
        score, code = torch.cat(scores, dim=1), torch.cat(codes, dim=1)
        anchor = torch.cat(anchors)
        boxes = [
            self._propose(score[k].detach(), code[k].detach(), anchor, counts, size)
            for k, size in enumerate(sizes)
        ]
        losses = {} if truth is None else _losses(score, code, anchor, truth)
        return Proposals(boxes, losses)

    def _propose(
        self,
        score: Tensor,
        code: Tensor,
        anchor: Tensor,
        counts: list[int],
        size: tuple[int, int],
    ) -> Tensor:
        """The best boxes (N, 4) of one image."""
        parts = []
        levels = zip(
            *(torch.split(values, counts) for values in (score, code, anchor)),
            strict=True,
        )
        for level_score, level_code, level_anchor in levels:
            best = level_score.topk(min(len(level_score), _BEFORE_SUPPRESSION))
            boxes = decode_boxes(level_code[best.indices], level_anchor[best.indices])
            boxes = clip_boxes(boxes, *size)
            large = large_boxes(boxes, _LEAST_SIZE)
            boxes, values = boxes[large], best.values[large]
            kept = suppress(boxes, values, _MAX_IOU)
            parts.append((values[kept], boxes[kept]))
        values, boxes = (torch.cat(part) for part in zip(*parts, strict=True))
        return boxes[values.topk(min(len(values), self._count)).indices]


def _by_anchor(x: Tensor, values: int) -> Tensor:
    """(B, A * values, height, width) as (B, height * width * A, values), in float32."""
    return x.permute(0, 2, 3, 1).reshape(len(x), -1, values).float()


def _losses(
    score: Tensor, code: Tensor, anchor: Tensor, truth: Sequence[Tensor]
) -> dict[str, Tensor]:
    objectness, shift = [], []
    for k, boxes in enumerate(truth):
        matched = match(anchor, boxes, _FOREGROUND, _BACKGROUND, keep_best=True)
        positive, negative = sample(matched, _SAMPLES, _POSITIVE_SHARE)
        index = torch.cat([positive, negative])
        label = torch.zeros(len(index), device=score.device)
        label[: len(positive)] = 1.0
        objectness.append(
            functional.binary_cross_entropy_with_logits(score[k, index], label)
        )
        goal = encode_boxes(boxes[matched[positive]], anchor[positive])
        shift.append(
            functional.smooth_l1_loss(
                code[k, positive], goal, beta=_BETA, reduction="sum"
            )
            / max(len(index), 1)
        )
    return {
        "loss_objectness": torch.stack(objectness).mean(),
        "loss_rpn_box": torch.stack(shift).mean(),
    }
