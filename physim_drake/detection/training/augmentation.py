# SPDX-License-Identifier: MIT
"""Turns one training image into endlessly many.

Each sample draws which objects of another image are pasted in (Ghiasi et al., "Simple
Copy-Paste", CVPR 2021), what replaces the background, zoom, shift and turn, and the
errors of cameras (`photometry`). Images are never mirrored: a mirrored
print does not exist.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from physim_drake.datasets.bop import mask_bounds
from physim_drake.detection.networks.image_batch import Target
from physim_drake.detection.training.packed_images import (
    LabelledImage,
    MixedImages,
    TrainingImages,
)
from physim_drake.detection.training.photometry import PhotometryConfig, take_photo
from physim_drake.poses import Array
from physim_drake.rendering.vivid import draw_texture

_LEAST_PIXELS = 40


@dataclass(frozen=True)
class AugmentationConfig:
    """How much images are changed.

    Attributes:
        zoom: range of the scale factor.
        max_shift: largest shift, as a share of the image's size.
        max_turn: largest turn, rad.
        background: share of images whose background is replaced.
        backgrounds: number of backgrounds to choose from.
        paste: share of images that objects of another image are pasted into.
        max_pasted: largest number of objects pasted in.
        occluder: share of images of which something hides a part.
        photometry: errors of the camera.
    """

    zoom: tuple[float, float] = (0.7, 2.0)
    max_shift: float = 0.25
    max_turn: float = 0.3
    background: float = 0.3
    backgrounds: int = 200
    paste: float = 0.5
    max_pasted: int = 3
    occluder: float = 0.2
    photometry: PhotometryConfig = field(default_factory=PhotometryConfig)

    def calmed(self) -> AugmentationConfig:
        """The same with smaller changes, so that images look much as they were made."""
        return replace(
            self,
            zoom=(self.zoom[0] ** 0.4, self.zoom[1] ** 0.4),
            max_shift=0.4 * self.max_shift,
            max_turn=0.5 * self.max_turn,
            background=0.2 * self.background,
            paste=0.2 * self.paste,
            occluder=0.2 * self.occluder,
            photometry=self.photometry.calmed(),
        )


@dataclass(frozen=True)
class Sample:
    """An image to learn from, with its ground truth.

    Attributes:
        image: (C, height, width) float32, colour in 0..1, depth in m.
        target: boxes, labels and masks.
    """

    image: torch.Tensor
    target: Target


class Augmenter:
    """Draws samples.

    Args:
        images: images to draw from.
        labels: label of each object id.
        size: height and width of the samples, px.
        config: amount of the changes.
        seed: seed of the backgrounds.
    """

    def __init__(
        self,
        images: TrainingImages | MixedImages,
        labels: dict[int, int],
        size: tuple[int, int],
        config: AugmentationConfig = AugmentationConfig(),
        seed: int = 0,
    ) -> None:
        self._images, self._labels, self._config = images, labels, config
        self._size, self._calm = size, config.calmed()
        rng = np.random.default_rng([seed, 1])
        self._backgrounds = [draw_texture(rng) for _ in range(config.backgrounds)]

    def draw(self, rng: np.random.Generator, *, calm: bool = False) -> Sample:
        """One sample. The same state of `rng` gives the same sample.

        Args:
            rng: source of the changes.
            calm: whether to make small changes only.
        """
        config = self._calm if calm else self._config
        image = self._image(rng)
        if rng.random() < config.background:
            image = self._other_background(image, rng)
        if rng.random() < config.paste:
            image = self._pasted(image, self._image(rng), rng)
        image = self._moved(image, config, rng)
        if rng.random() < config.occluder:
            image = self._occluded(image, rng)
        color = take_photo(image.color, config.photometry, rng)
        return make_sample(color, image, self._labels)

    def _image(self, rng: np.random.Generator) -> LabelledImage:
        return self._images[int(rng.integers(len(self._images)))]

    def _texture(
        self, shape: tuple[int, ...], rng: np.random.Generator
    ) -> NDArray[np.uint8]:
        """A part of a background, stretched to (height, width, 3)."""
        source = self._backgrounds[int(rng.integers(len(self._backgrounds)))]
        side = int(rng.integers(24, source.shape[0] + 1))
        top, left = rng.integers(0, source.shape[0] - side + 1, 2)
        part = source[top : top + side, left : left + side]
        return np.asarray(cv2.resize(part, (shape[1], shape[0])), dtype=np.uint8)

    def _other_background(
        self, image: LabelledImage, rng: np.random.Generator
    ) -> LabelledImage:
        alpha = _soft(image.labels > 0, rng)
        color = _blend(image.color, self._texture(image.labels.shape, rng), alpha)
        return LabelledImage(color, image.labels, image.object_ids, image.depth)

    def _pasted(
        self, image: LabelledImage, other: LabelledImage, rng: np.random.Generator
    ) -> LabelledImage:
        color, labels = image.color.copy(), image.labels.copy()
        depth = None if image.depth is None else image.depth.copy()
        ids = list(image.object_ids)
        chosen = rng.permutation(len(other.object_ids))
        for k in chosen[: int(rng.integers(1, self._config.max_pasted + 1))]:
            mask = other.labels == k + 1
            if mask.sum() < _LEAST_PIXELS:
                continue
            zoom = np.exp(rng.uniform(-0.5, 0.5))
            matrix = _paste_motion(mask, zoom, rng)
            size = (labels.shape[1], labels.shape[0])
            moved = np.asarray(
                cv2.warpAffine(mask.astype(np.float32), matrix, size), np.float32
            )
            seen = moved > 0.5
            light = rng.uniform(0.6, 1.4)
            pasted = cv2.warpAffine(other.color, matrix, size) * light
            color = _blend(np.clip(pasted, 0, 255), color, moved)
            ids.append(other.object_ids[k])
            labels[seen] = len(ids)
            if depth is not None and other.depth is not None:
                far = cv2.warpAffine(other.depth, matrix, size, flags=cv2.INTER_NEAREST)
                depth[seen] = far[seen] / np.float32(zoom)
        return LabelledImage(color, labels, tuple(ids), depth)

    def _moved(
        self,
        image: LabelledImage,
        config: AugmentationConfig,
        rng: np.random.Generator,
    ) -> LabelledImage:
        """The image at the size of samples, zoomed, shifted and turned."""
        height, width = self._size
        low, high = np.log(config.zoom)
        zoom = np.exp(rng.uniform(low, high))
        matrix = _motion(
            np.array(image.labels.shape[::-1]) / 2,
            np.array([width, height])
            * (0.5 + rng.uniform(-1, 1, 2) * config.max_shift * min(zoom, 1.0)),
            zoom * width / image.labels.shape[1],
            rng.uniform(-config.max_turn, config.max_turn),
        )
        # What comes in at the borders has no labels, so it must show no objects.
        color = cv2.warpAffine(
            image.color,
            matrix,
            (width, height),
            dst=self._texture((height, width), rng),
            flags=cv2.INTER_AREA if zoom < 1 else cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_TRANSPARENT,
        )
        labels = cv2.warpAffine(
            image.labels, matrix, (width, height), flags=cv2.INTER_NEAREST
        )
        depth = None
        if image.depth is not None:
            depth = cv2.warpAffine(
                image.depth, matrix, (width, height), flags=cv2.INTER_NEAREST
            )
            depth = np.asarray(depth, np.float32) / np.float32(zoom)
        return LabelledImage(
            np.asarray(color, np.uint8),
            np.asarray(labels, np.uint8),
            image.object_ids,
            depth,
        )

    def _occluded(
        self, image: LabelledImage, rng: np.random.Generator
    ) -> LabelledImage:
        """The image with a shape of any look before its objects."""
        height, width = image.labels.shape
        mask = np.zeros((height, width), np.float32)
        center = rng.uniform(0, [width, height])
        reach = rng.uniform(0.05, 0.3, (int(rng.integers(3, 8)), 1)) * width
        angles = np.sort(rng.uniform(0, 2 * np.pi, len(reach)))[:, None]
        corners = center + reach * np.hstack([np.cos(angles), np.sin(angles)])
        cv2.fillPoly(mask, [corners.astype(np.int32)], 1.0)
        color = _blend(self._texture((height, width), rng), image.color, mask)
        labels = np.where(mask > 0.5, 0, image.labels).astype(np.uint8)
        depth = image.depth
        if depth is not None:
            depth = np.where(mask > 0.5, depth * np.float32(0.8), depth)
        return LabelledImage(color, labels, image.object_ids, depth)


def make_sample(
    color: NDArray[np.float32], image: LabelledImage, labels: dict[int, int]
) -> Sample:
    """An image and its ground truth as tensors. Objects of a few pixels are left out.

    Args:
        color: (height, width, 3), 0..255, in place of the image's.
        image: the image.
        labels: label of each object id.
    """
    planes = [color.transpose(2, 0, 1) / np.float32(255.0)]
    if image.depth is not None:
        planes.append(image.depth[None])
    counts = np.bincount(image.labels.ravel(), minlength=len(image.object_ids) + 1)
    shown = [k for k in range(len(image.object_ids)) if counts[k + 1] >= _LEAST_PIXELS]
    masks = image.labels[None] == np.array(shown, dtype=int)[:, None, None] + 1
    boxes = np.array([mask_bounds(mask) for mask in masks], np.float32)
    return Sample(
        torch.from_numpy(np.ascontiguousarray(np.concatenate(planes))),
        {
            "boxes": torch.from_numpy(boxes.reshape(-1, 4)),
            "labels": torch.tensor(
                [labels[image.object_ids[k]] for k in shown], dtype=torch.int64
            ),
            "masks": torch.from_numpy(masks),
        },
    )


def _motion(center: Array, target: Array, zoom: float, turn: float) -> Array:
    """The matrix (2, 3) that turns and scales about a point and moves it to another."""
    cosine, sine = zoom * np.cos(turn), zoom * np.sin(turn)
    linear = np.array([[cosine, -sine], [sine, cosine]])
    return np.hstack([linear, (target - linear @ center)[:, None]])


def _paste_motion(
    mask: NDArray[np.bool_], zoom: float, rng: np.random.Generator
) -> Array:
    """Brings the object of a mask anywhere into the image, turned any way."""
    left, top, right, bottom = mask_bounds(mask)
    center = np.array([left + right, top + bottom]) / 2
    target = rng.uniform(0.05, 0.95, 2) * mask.shape[::-1]
    return _motion(center, target, zoom, rng.uniform(-np.pi, np.pi))


def _soft(mask: NDArray[np.bool_], rng: np.random.Generator) -> NDArray[np.float32]:
    """A mask whose edge is soft, as through a lens."""
    blur = rng.uniform(0.3, 1.2)
    return np.asarray(
        cv2.GaussianBlur(mask.astype(np.float32), (0, 0), blur), np.float32
    )


def _blend(
    front: NDArray[np.generic], back: NDArray[np.uint8], alpha: NDArray[np.float32]
) -> NDArray[np.uint8]:
    share = alpha[..., None]
    mixed = back + share * (front.astype(np.float32) - back)
    return mixed.astype(np.uint8)
