# SPDX-License-Identifier: MIT
"""Images of any sizes as one normalised tensor, and results back in their pixels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from physim_drake.errors import InputError

Target = Mapping[str, Tensor]
"""Truth of an image: `boxes` (N, 4) px, `labels` (N,) int64 from 1, `masks` (N, height,
width)."""

_MULTIPLE = 32
_MEAN, _SPREAD = 0.45, 0.25
_DEPTH_MEAN, _DEPTH_SPREAD = 0.7, 0.3  # m


@dataclass(frozen=True)
class ImageBatch:
    """Images side by side.

    Attributes:
        tensor: (B, C, height, width), sides multiples of 32, 0 beyond an image.
        sizes: height and width of each scaled image, px.
        original_sizes: height and width of each image before scaling, px.
    """

    tensor: Tensor
    sizes: tuple[tuple[int, int], ...]
    original_sizes: tuple[tuple[int, int], ...]

    def scale(self, index: int) -> tuple[float, float]:
        """Factors of an image's width and height from original to scaled pixels."""
        size, original = self.sizes[index], self.original_sizes[index]
        return size[1] / original[1], size[0] / original[0]

    def to_scaled(self, boxes: Tensor, index: int) -> Tensor:
        """Boxes (N, 4) of an original image in pixels of the scaled one."""
        return boxes * boxes.new_tensor(self.scale(index) * 2)

    def to_original(self, boxes: Tensor, index: int) -> Tensor:
        """Boxes (N, 4) of a scaled image in pixels of the original one."""
        return boxes / boxes.new_tensor(self.scale(index) * 2)


def make_batch(images: Sequence[Tensor], channels: int, longer_side: int) -> ImageBatch:
    """Scales, normalises and stacks images.

    Args:
        images: (C, height, width) each: red, green, blue in 0..1 and, if there is a
            fourth channel, depth in m, 0 if not measured.
        channels: number of channels C.
        longer_side: longer side of the scaled images, px.

    Raises:
        InputError: if an image has another number of channels.
    """
    scaled = []
    for image in images:
        if image.ndim != 3 or image.shape[0] != channels:
            raise InputError(
                "image",
                f"is of shape {tuple(image.shape)}",
                f"the network takes {channels} channels, (C, height, width)",
            )
        scaled.append(_normalise(_resize(image, longer_side)))
    sizes = tuple((image.shape[1], image.shape[2]) for image in scaled)
    height, width = (
        -(-max(size[axis] for size in sizes) // _MULTIPLE) * _MULTIPLE
        for axis in (0, 1)
    )
    stacked = torch.stack(
        [
            functional.pad(image, (0, width - image.shape[2], 0, height - size[0]))
            for image, size in zip(scaled, sizes, strict=True)
        ]
    )
    originals = tuple((image.shape[1], image.shape[2]) for image in images)
    return ImageBatch(
        stacked.contiguous(memory_format=torch.channels_last), sizes, originals
    )


def _resize(image: Tensor, longer_side: int) -> Tensor:
    height, width = image.shape[1:]
    factor = longer_side / max(height, width)
    if factor == 1.0:
        return image
    size = (max(round(height * factor), 1), max(round(width * factor), 1))
    color = functional.interpolate(
        image[None, :3], size, mode="bilinear", antialias=True
    )[0]
    if len(image) == 3:
        return color
    # Depths are never mixed: the mean of an edge's two sides lies on neither.
    depth = functional.interpolate(image[None, 3:], size, mode="nearest-exact")[0]
    return torch.cat([color, depth])


def _normalise(image: Tensor) -> Tensor:
    color = (image[:3] - _MEAN) / _SPREAD
    if len(image) == 3:
        return color
    depth = image[3:]
    depth = torch.where(depth > 0, (depth - _DEPTH_MEAN) / _DEPTH_SPREAD, 0.0)
    return torch.cat([color, depth.clamp(-3.0, 3.0)])
