# SPDX-License-Identifier: MIT
"""Pictures that show at a glance whether an estimate is right.

The left half is the colour image with each estimated model tinted, outlined and named.
The right half shows how far each model's surface lies from the measured one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physim_drake.camera import DepthImage
from physim_drake.objects.model import ObjectModel
from physim_drake.observation.observation import RgbdObservation
from physim_drake.rendering.captions import FONT, Captions, font_scale
from physim_drake.rendering.colors import diverging_colors, object_color
from physim_drake.rendering.depth import DepthRenderer
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from physim_drake.storage.files import write_atomically

Image = NDArray[np.uint8]

RESIDUAL_RANGE = 0.02
"""Depth residual at either end of the colour scale, m."""

_TINT = 0.4
_DIM = 0.35
_UNMEASURED = (40, 40, 40)


@dataclass(frozen=True)
class SceneLabels:
    """What the estimated objects look like from the camera.

    Attributes:
        depth: depth, m, (height, width) float32, 0 beside the objects.
        labels: index into the estimate's objects, (height, width), or -1.
    """

    depth: DepthImage
    labels: NDArray[np.int16]


def draw_overlay(
    observation: RgbdObservation,
    estimate: SceneEstimate,
    library: Mapping[int, ObjectModel],
    renderer: DepthRenderer | None = None,
) -> Image:
    """Draws an estimate over its image, beside a map of the depth residuals.

    The residual is rendered minus measured depth. It is blue where the model is nearer
    to the camera than what was measured, red where it is farther, and white where they
    agree. Pixels without a measurement are dark grey.

    Args:
        observation: image. Without colour its depth is drawn.
        estimate: estimate of the objects in it.
        library: models of the objects.
        renderer: renderer of these models and this camera, if you have one already.

    Returns:
        (height, 2 width, 3) uint8 RGB.
    """
    if renderer is None:
        shown = {o.object_id: library[o.object_id] for o in estimate.objects if o.found}
        renderer = DepthRenderer(shown, observation.intrinsics)
    scene = render_labels(estimate.objects, renderer)
    background = _background(observation)
    left = _tinted(background, estimate.objects, scene)
    right = _residuals(background, observation.depth, scene)
    return np.ascontiguousarray(np.hstack([left, right]))


def render_labels(
    objects: Sequence[ObjectEstimate], renderer: DepthRenderer
) -> SceneLabels:
    """Renders the found objects together. In each pixel the nearest one shows."""
    shape = (renderer.intrinsics.height, renderer.intrinsics.width)
    depth = np.zeros(shape, dtype=np.float32)
    labels = np.full(shape, -1, dtype=np.int16)
    for index, item in enumerate(objects):
        if item.X_CO is None:
            continue
        image = renderer.render(item.object_id, item.X_CO)
        nearer = (image > 0) & ((depth == 0) | (image < depth))
        depth = np.where(nearer, image, depth)
        labels[nearer] = index
    return SceneLabels(depth, labels)


def _background(observation: RgbdObservation) -> Image:
    """The colour image, or else the depth in grey, of which near is bright."""
    if observation.color is not None:
        return observation.color
    depth = observation.depth
    near, far = np.percentile(depth[depth > 0], [1, 99])
    grey = 230 - 180 * np.clip((depth - near) / max(far - near, 1e-3), 0, 1)
    grey[depth == 0] = 0
    return np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)


def _tinted(
    background: Image, objects: Sequence[ObjectEstimate], scene: SceneLabels
) -> Image:
    image = background.astype(float)
    for index in range(len(objects)):
        mask = scene.labels == index
        image[mask] = (1 - _TINT) * image[mask] + _TINT * np.array(object_color(index))
    canvas = np.ascontiguousarray(image.astype(np.uint8))
    for index in range(len(objects)):
        mask = (scene.labels == index).astype(np.uint8)
        edges, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(canvas, edges, -1, object_color(index), 2, cv2.LINE_AA)
    captions = Captions(canvas)
    for index, item in enumerate(objects):
        rows, columns = np.nonzero(scene.labels == index)
        if item.found and len(rows):
            text = f"{item.name} {item.confidence:.2f}"
            place = int(columns.mean()), int(rows.min())
            captions.write(text, *place, object_color(index), centred=True)
    return canvas


def _residuals(background: Image, measured: DepthImage, scene: SceneLabels) -> Image:
    grey = background.mean(axis=2, keepdims=True) * _DIM
    image = np.repeat(grey, 3, axis=2).astype(np.uint8)
    drawn = scene.labels >= 0
    image[drawn] = _UNMEASURED
    both = drawn & (measured > 0)
    error = scene.depth[both] - measured[both]
    image[both] = diverging_colors(error / RESIDUAL_RANGE)
    share = float(np.mean(np.abs(error) < 0.01)) if both.any() else 0.0
    _legend(image, f"rendered - measured; {share:.0%} within 1 cm")
    return image


def _legend(image: Image, title: str) -> None:
    """Draws the colour scale along the bottom."""
    height, width = image.shape[:2]
    scale = font_scale(image)
    (_, line), _ = cv2.getTextSize("0", FONT, scale, 1)
    bar = max(line, 6)
    left, right = int(0.25 * width), int(0.75 * width)
    top = height - bar - line - 12
    ramp = diverging_colors(np.linspace(-1.0, 1.0, right - left))
    image[top : top + bar, left:right] = ramp[None]
    centimetres = f"{RESIDUAL_RANGE * 100:g} cm"
    for text, column in (
        (f"-{centimetres}", left),
        ("0", (left + right) // 2),
        (f"+{centimetres}", right),
    ):
        _centred(image, text, column, height - 6, scale)
    _centred(image, title, (left + right) // 2, top - 6, scale)


def _centred(image: Image, text: str, column: int, bottom: int, scale: float) -> None:
    (width, _), _ = cv2.getTextSize(text, FONT, scale, 1)
    place = (column - width // 2, bottom)
    cv2.putText(image, text, place, FONT, scale, (255, 255, 255), 1, cv2.LINE_AA)


def write_png(path: str | Path, image: Image) -> None:
    """Writes an RGB image; raises `InputError` if `path` cannot be written."""
    _, data = cv2.imencode(".png", np.ascontiguousarray(image[..., ::-1]))
    with write_atomically(Path(path), "wb") as file:
        file.write(data.tobytes())
