# SPDX-License-Identifier: MIT
"""The heads: the box head classifies and places proposals, the mask head masks them.

Ren et al., "Faster R-CNN", NeurIPS 2015, and He et al., "Mask R-CNN", ICCV 2017.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from physim_drake.detection.networks.anchors import match, sample
from physim_drake.detection.networks.boxes import (
    clip_boxes,
    decode_boxes,
    encode_boxes,
    large_boxes,
    suppress_by_group,
)
from physim_drake.detection.networks.roi_align import pyramid_levels, roi_align

BOX_CELLS, MASK_CELLS = 7, 14

_FINEST = 64.0  # px, the largest box that is read at stride 4
_FOREGROUND = 0.5
_SAMPLES, _POSITIVE_SHARE = 64, 0.35
_BOX_SCALE = (10.0, 5.0)
_BETA = 1.0 / 9
_LEAST_SIZE = 2.0  # px


@dataclass(frozen=True)
class Samples:
    """Proposals to learn from, of all images of a batch.

    Attributes:
        boxes: (N, 4), px. Those that stand for a true box come first in each image.
        images: (N,).
        labels: (N,), 0 for background.
        truth: true boxes, (N, 4), px. Meaningless for background.
        instances: index of the true box in its image, -1 for background, (N,).
    """

    boxes: Tensor
    images: Tensor
    labels: Tensor
    truth: Tensor
    instances: Tensor


def choose_samples(
    proposals: Sequence[Tensor], truth: Sequence[Tensor], labels: Sequence[Tensor]
) -> Samples:
    """Chooses proposals to learn from, by torch's random numbers.

    Args:
        proposals: proposals of each image, (N, 4), px.
        truth: true boxes of each image, (M, 4), px. They also count as proposals.
        labels: classes of the true boxes, (M,), from 1.
    """
    parts: list[tuple[Tensor, ...]] = []
    for k, (proposed, boxes, label) in enumerate(
        zip(proposals, truth, labels, strict=True)
    ):
        candidates = torch.cat([boxes, proposed])
        matched = match(candidates, boxes, _FOREGROUND, _FOREGROUND)
        positive, negative = sample(matched, _SAMPLES, _POSITIVE_SHARE)
        index = torch.cat([positive, negative])
        instance = matched[index].clamp(min=-1)
        true_box = candidates[index].clone()
        true_box[: len(positive)] = boxes[matched[positive]]
        classes = torch.zeros_like(instance)
        classes[: len(positive)] = label[matched[positive]]
        image = torch.full_like(instance, k)
        parts.append((candidates[index], image, classes, true_box, instance))
    return Samples(*(torch.cat(column) for column in zip(*parts, strict=True)))


class BoxHead(nn.Module):
    """Two fully connected layers, then scores of all classes and one box.

    Args:
        channels: channels of the pyramid.
        hidden: width of the layers.
        classes: number of classes, without background.
    """

    def __init__(self, channels: int, hidden: int, classes: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Flatten(),
            nn.Linear(channels * BOX_CELLS**2, hidden),
            nn.ReLU(inplace=True),
            nn.Linear(hidden, hidden),
            nn.ReLU(inplace=True),
        )
        self.score = nn.Linear(hidden, classes + 1)
        self.shift = nn.Linear(hidden, 4)
        nn.init.normal_(self.score.weight, std=0.01)
        nn.init.normal_(self.shift.weight, std=0.001)

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Scores (N, classes + 1) and box codes (N, 4) of features (N, C, 7, 7)."""
        x = self.layers(features)
        return self.score(x).float(), self.shift(x).float()


class MaskHead(nn.Module):
    """Convolutions, twice the resolution, and a mask for each class.

    Args:
        channels: channels of the pyramid.
        layers: convolutions before the resolution doubles.
        classes: number of classes, without background.
    """

    def __init__(self, channels: int, layers: int, classes: int) -> None:
        super().__init__()
        convolutions: list[nn.Module] = []
        for _ in range(layers):
            convolutions += [
                nn.Conv2d(channels, channels, 3, padding=1),
                nn.ReLU(inplace=True),
            ]
        self.layers = nn.Sequential(
            *convolutions,
            nn.ConvTranspose2d(channels, channels, 2, stride=2),
            nn.ReLU(inplace=True),
        )
        self.score = nn.Conv2d(channels, classes, 1)
        for layer in self.modules():
            if isinstance(layer, nn.Conv2d | nn.ConvTranspose2d):
                nn.init.kaiming_normal_(
                    layer.weight, mode="fan_out", nonlinearity="relu"
                )
                nn.init.zeros_(layer.bias)  # type: ignore[arg-type]

    def forward(self, features: Tensor, labels: Tensor) -> Tensor:
        """Mask scores (N, 28, 28) for classes (N,) of features (N, C, 14, 14)."""
        scores: Tensor = self.score(self.layers(features))
        return scores[torch.arange(len(labels)), labels - 1].float()


def read_features(
    maps: Sequence[Tensor],
    strides: Sequence[int],
    boxes: Tensor,
    images: Tensor,
    cells: int,
) -> Tensor:
    """Features (N, C, cells, cells) of boxes (N, 4) from the level that fits each."""
    levels = pyramid_levels(boxes, len(maps), _FINEST)
    return roi_align(maps, strides, boxes, images, levels, cells)


def box_losses(scores: Tensor, codes: Tensor, samples: Samples) -> dict[str, Tensor]:
    """How wrong the box head is about samples."""
    positive = torch.nonzero(samples.labels > 0).flatten()
    goal = encode_boxes(samples.truth[positive], samples.boxes[positive], _BOX_SCALE)
    shift = functional.smooth_l1_loss(
        codes[positive], goal, beta=_BETA, reduction="sum"
    )
    return {
        "loss_classifier": functional.cross_entropy(scores, samples.labels),
        "loss_box": shift / max(len(samples.labels), 1),
    }


def mask_loss(scores: Tensor, goals: Tensor) -> Tensor:
    """How wrong mask scores (N, S, S) are about masks (N, S, S) of 0..1."""
    if len(scores) == 0:
        return scores.sum()
    return functional.binary_cross_entropy_with_logits(scores, goals)


def mask_goals(masks: Sequence[Tensor], samples: Samples, cells: int) -> Tensor:
    """What masks (N, cells, cells) the samples should get, 0..1.

    Args:
        masks: masks of each image, (M, height, width), in its scaled pixels.
        samples: samples that stand for a true box.
        cells: cells along each side.
    """
    counts = [len(m) for m in masks]
    stack = torch.cat([m[:, None].float() for m in masks])
    starts = torch.tensor([sum(counts[:k]) for k in range(len(counts))])
    index = starts.to(samples.images.device)[samples.images] + samples.instances
    level = torch.zeros_like(index)
    return roi_align([stack], [1], samples.boxes, index, level, cells)[:, 0]


def choose_detections(
    scores: Tensor,
    codes: Tensor,
    proposals: Tensor,
    size: tuple[int, int],
    least_score: float,
    max_iou: float,
    count: int,
) -> tuple[Tensor, Tensor, Tensor]:
    """The detections of one image.

    Args:
        scores: scores of the box head, (N, classes + 1).
        codes: codes of the box head, (N, 4).
        proposals: (N, 4), px.
        size: height and width of the image, px.
        least_score: probability below which detections are dropped.
        max_iou: largest overlap of two detections of one class.
        count: largest number of detections.

    Returns:
        boxes (M, 4), labels (M,) and scores (M,), best first.
    """
    probability = scores.softmax(dim=1)[:, 1:]
    boxes = clip_boxes(decode_boxes(codes, proposals, _BOX_SCALE), *size)
    index, label = torch.nonzero(probability >= least_score, as_tuple=True)
    score, boxes = probability[index, label], boxes[index]
    large = large_boxes(boxes, _LEAST_SIZE)
    boxes, score, label = boxes[large], score[large], label[large]
    kept = suppress_by_group(boxes, score, label, max_iou)[:count]
    return boxes[kept], label[kept] + 1, score[kept]
