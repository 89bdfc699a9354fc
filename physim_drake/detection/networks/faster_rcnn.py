# SPDX-License-Identifier: MIT
"""Faster R-CNN with masks: from images to boxes, labels, scores and masks.

It is called as torchvision's detection models are, so that one can stand in for the
other. Ren et al., "Faster R-CNN", NeurIPS 2015. He et al., "Mask R-CNN", ICCV 2017.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from physim_drake.detection.networks.backbones import STRIDES, FeaturePyramid
from physim_drake.detection.networks.config import NetworkConfig
from physim_drake.detection.networks.heads import (
    BOX_CELLS,
    MASK_CELLS,
    BoxHead,
    MaskHead,
    Samples,
    box_losses,
    choose_detections,
    choose_samples,
    mask_goals,
    mask_loss,
    read_features,
)
from physim_drake.detection.networks.image_batch import ImageBatch, Target, make_batch
from physim_drake.detection.networks.pixel_head import PixelHead, pixel_loss
from physim_drake.detection.networks.region_proposals import (
    FIRST_LEVEL,
    RegionProposalNetwork,
)


class FasterRcnn(nn.Module):
    """Finds objects and their masks.

    Args:
        config: configuration of the network.
        classes: number of classes, without background.
        least_score: probability below which detections are not reported.
        max_detections: largest number of detections in an image.
    """

    def __init__(
        self,
        config: NetworkConfig,
        classes: int,
        least_score: float = 0.05,
        max_detections: int = 30,
    ) -> None:
        super().__init__()
        self.config = config
        self.least_score, self.max_detections = least_score, max_detections
        self.max_iou = 0.5
        channels = config.pyramid_channels
        self.pyramid = FeaturePyramid(config)
        self.proposals = RegionProposalNetwork(channels, STRIDES[FIRST_LEVEL:])
        self.box_head = BoxHead(channels, config.head_channels, classes)
        self.mask_head = MaskHead(channels, config.mask_layers, classes)
        self.pixels = PixelHead(channels, classes)

    def forward(
        self, images: Sequence[Tensor], targets: Sequence[Target] | None = None
    ) -> dict[str, Tensor] | list[dict[str, Tensor]]:
        """Losses when it trains, detections otherwise.

        Args:
            images: (C, height, width) each, colour in 0..1, depth in m.
            targets: true boxes, labels and masks of each, needed to train.

        Returns:
            losses by name, or for each image `boxes` (N, 4) px, `labels` (N,) from 1,
            `scores` (N,) and `masks` (N, 1, height, width), 0..1, best first.
        """
        batch = make_batch(images, self.config.channels, self.config.image_size)
        maps = self.pyramid(batch.tensor)
        if not self.training:
            return self._detect(maps, batch)
        if targets is None:
            raise ValueError("targets are needed in training")
        pixels = pixel_loss(self.pixels(maps[0]), targets, batch)
        return {**self._losses(maps, batch, targets), "loss_pixels": pixels}

    def _losses(
        self, maps: Sequence[Tensor], batch: ImageBatch, targets: Sequence[Target]
    ) -> dict[str, Tensor]:
        truth = [batch.to_scaled(t["boxes"], k) for k, t in enumerate(targets)]
        found = self.proposals(maps[FIRST_LEVEL:], batch.sizes, truth)
        samples = choose_samples(found.boxes, truth, [t["labels"] for t in targets])
        features = read_features(
            maps, STRIDES, samples.boxes, samples.images, BOX_CELLS
        )
        scores, codes = self.box_head(features)
        losses = found.losses | box_losses(scores, codes, samples)
        positive = samples.labels > 0
        shown = Samples(
            samples.boxes[positive],
            samples.images[positive],
            samples.labels[positive],
            samples.truth[positive],
            samples.instances[positive],
        )
        masks = [_scaled(t["masks"], batch.sizes[k]) for k, t in enumerate(targets)]
        mask_scores = self.mask_head(
            read_features(maps, STRIDES, shown.boxes, shown.images, MASK_CELLS),
            shown.labels,
        )
        goals = mask_goals(masks, shown, 2 * MASK_CELLS)
        return {**losses, "loss_mask": mask_loss(mask_scores, goals)}

    def _detect(
        self, maps: Sequence[Tensor], batch: ImageBatch
    ) -> list[dict[str, Tensor]]:
        proposals = self.proposals(maps[FIRST_LEVEL:], batch.sizes).boxes
        results = []
        for k, boxes in enumerate(proposals):
            own = [m[k : k + 1] for m in maps]
            first = torch.zeros(len(boxes), dtype=torch.int64, device=boxes.device)
            scores, codes = self.box_head(
                read_features(own, STRIDES, boxes, first, BOX_CELLS)
            )
            boxes, labels, score = choose_detections(
                scores,
                codes,
                boxes,
                batch.sizes[k],
                self.least_score,
                self.max_iou,
                self.max_detections,
            )
            masks = self.mask_head(
                read_features(own, STRIDES, boxes, first[: len(boxes)], MASK_CELLS),
                labels,
            ).sigmoid()
            boxes = batch.to_original(boxes, k)
            results.append(
                {
                    "boxes": boxes,
                    "labels": labels,
                    "scores": score,
                    "masks": paste_masks(masks, boxes, *batch.original_sizes[k]),
                }
            )
        return results


def paste_masks(masks: Tensor, boxes: Tensor, height: int, width: int) -> Tensor:
    """Puts masks into an image.

    Args:
        masks: (N, S, S), 0..1, each stretched over its box.
        boxes: (N, 4), px.
        height: height of the image, px.
        width: width of the image, px.

    Returns:
        (N, 1, height, width), 0 outside the boxes.
    """
    image = masks.new_zeros(len(masks), 1, height, width)
    for k, box in enumerate(boxes.round().to(torch.int64).tolist()):
        left, top = max(box[0], 0), max(box[1], 0)
        right, bottom = (
            min(max(box[2], left + 1), width),
            min(max(box[3], top + 1), height),
        )
        size = (bottom - top, right - left)
        if min(size) > 0:
            image[k, 0, top:bottom, left:right] = functional.interpolate(
                masks[None, k : k + 1], size, mode="bilinear"
            )[0, 0]
    return image


def _scaled(masks: Tensor, size: tuple[int, int]) -> Tensor:
    """Masks (N, height, width) at another size, 0..1."""
    if masks.shape[1:] == size or len(masks) == 0:
        return masks.float().reshape(len(masks), *size)
    return functional.interpolate(masks[:, None].float(), size, mode="bilinear")[:, 0]
