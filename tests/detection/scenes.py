# SPDX-License-Identifier: MIT
"""Small drawn images of things that are easy to tell apart."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from physim_drake.datasets.bop import mask_bounds
from physim_drake.detection.networks.config import NetworkConfig, NetworkKind
from physim_drake.detection.networks.factory import ObjectClass
from physim_drake.detection.training.augmentation import Sample, make_sample
from physim_drake.detection.training.packed_images import LabelledImage
from physim_drake.observation.observation import Detection

CLASSES = (ObjectClass(2, "red square"), ObjectClass(5, "green disc"))
LABELS = {2: 1, 5: 2}
COLORS = {2: (220, 40, 30), 5: (40, 200, 60)}
HEIGHT, WIDTH = 96, 128


def tiny(
    kind: NetworkKind = NetworkKind.FASTER_RCNN, channels: int = 3
) -> NetworkConfig:
    """A network that learns these images in seconds."""
    return NetworkConfig(
        kind=kind,
        channels=channels,
        image_size=WIDTH,
        widths=(16, 24, 32, 32),
        depths=(1, 1, 1, 1),
        pyramid_channels=24,
        head_channels=48,
        mask_layers=1,
    )


def draw_image(seed: int, depth: bool = False) -> LabelledImage:
    """A square and a disc, one of them perhaps before the other."""
    rng = np.random.default_rng(seed)
    color = np.full((HEIGHT, WIDTH, 3), rng.integers(60, 190), np.uint8)
    labels = np.zeros((HEIGHT, WIDTH), np.uint8)
    ids = [int(i) for i in rng.permutation([2, 5])]
    for k, object_id in enumerate(ids, start=1):
        half = int(rng.integers(10, 20))
        x = int(rng.integers(half, WIDTH - half))
        y = int(rng.integers(half, HEIGHT - half))
        shape = np.zeros_like(labels)
        if object_id == 2:
            shape[y - half : y + half, x - half : x + half] = 1
        else:
            cv2.circle(shape, (x, y), half, 1, -1)
        labels[shape > 0] = k
        color[shape > 0] = COLORS[object_id]
    color = (color + rng.normal(0, 4, color.shape)).clip(0, 255).astype(np.uint8)
    distance = np.where(labels > 0, 0.5, 0.7).astype(np.float32) if depth else None
    return LabelledImage(color, labels, tuple(ids), distance)


def sample_of(image: LabelledImage) -> Sample:
    """The image as it is."""
    return make_sample(image.color.astype(np.float32), image, LABELS)


def truth_of(image: LabelledImage) -> list[Detection]:
    """The objects of an image."""
    masks = {i: image.labels == k for k, i in enumerate(image.object_ids, start=1)}
    return [
        Detection(i, mask_bounds(mask), 1.0, mask)
        for i, mask in masks.items()
        if mask.sum() >= 40
    ]


def square_mask(left: int, top: int, side: int) -> NDArray[np.bool_]:
    """A mask of a square, (HEIGHT, WIDTH)."""
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[top : top + side, left : left + side] = True
    return mask
