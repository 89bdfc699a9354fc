# SPDX-License-Identifier: MIT
"""A fully convolutional network: the class of every pixel.

Long et al., "Fully Convolutional Networks for Semantic Segmentation", CVPR 2015. The
scores of coarse and fine features are joined in a feature pyramid. It is called as
`FasterRcnn` is, and reports each class at most once.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from physim_drake.detection.networks.backbones import FeaturePyramid
from physim_drake.detection.networks.config import NetworkConfig
from physim_drake.detection.networks.image_batch import ImageBatch, Target, make_batch
from physim_drake.detection.networks.pixel_head import PixelHead, pixel_loss

_LEAST_PIXELS = 40


class FullyConvolutionalNetwork(nn.Module):
    """Segments an image into classes.

    Args:
        config: configuration of the network.
        classes: number of classes, without background.
    """

    def __init__(self, config: NetworkConfig, classes: int) -> None:
        super().__init__()
        self.config = config
        self.pyramid = FeaturePyramid(config)
        self.pixels = PixelHead(config.pyramid_channels, classes)

    def forward(
        self, images: Sequence[Tensor], targets: Sequence[Target] | None = None
    ) -> dict[str, Tensor] | list[dict[str, Tensor]]:
        """Losses when it trains, detections otherwise. See `FasterRcnn.forward`."""
        batch = make_batch(images, self.config.channels, self.config.image_size)
        scores = self.pixels(self.pyramid(batch.tensor)[0])
        if not self.training:
            return self._detect(scores, batch)
        if targets is None:
            raise ValueError("targets are needed in training")
        return {"loss_pixels": pixel_loss(scores, targets, batch)}

    def _detect(self, scores: Tensor, batch: ImageBatch) -> list[dict[str, Tensor]]:
        results = []
        scores = functional.interpolate(scores, batch.tensor.shape[2:], mode="bilinear")
        for k, size in enumerate(batch.sizes):
            own = functional.interpolate(
                scores[k : k + 1, :, : size[0], : size[1]],
                batch.original_sizes[k],
                mode="bilinear",
            )[0]
            results.append(_class_segments(own.softmax(dim=0)))
        return results


def _class_segments(probability: Tensor) -> dict[str, Tensor]:
    """Detections of the pixels in which a class is the most probable one.

    Args:
        probability: (classes + 1, height, width).
    """
    value, winner = probability.max(dim=0)
    masks, labels, scores, boxes = [], [], [], []
    for label in torch.unique(winner).tolist():
        mask = winner == label
        if label == 0 or int(mask.sum()) < _LEAST_PIXELS:
            continue
        rows, columns = torch.nonzero(mask, as_tuple=True)
        corners = (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
        boxes.append(torch.stack(corners).float())
        masks.append(mask.float())
        labels.append(label)
        scores.append(value[mask].mean())
    if not labels:
        empty = probability.new_zeros(0)
        return {
            "boxes": empty.reshape(0, 4),
            "labels": empty.to(torch.int64),
            "scores": empty,
            "masks": empty.reshape(0, 1, *winner.shape),
        }
    score = torch.stack(scores)
    order = score.argsort(descending=True)
    return {
        "boxes": torch.stack(boxes)[order],
        "labels": torch.tensor(labels, device=score.device)[order],
        "scores": score[order],
        "masks": torch.stack(masks)[order][:, None],
    }
