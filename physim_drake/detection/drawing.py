# SPDX-License-Identifier: MIT
"""Pictures of detections: each mask tinted, boxed and named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import matplotlib
import numpy as np
from numpy.typing import NDArray

from physim_drake.observation import Detection

_COLORS = (matplotlib.colormaps["tab20"](np.arange(20))[:, :3] * 255).astype(int)
_TINT = 0.45
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_detections(
    color: NDArray[np.uint8],
    detections: Sequence[Detection],
    names: Mapping[int, str],
) -> NDArray[np.uint8]:
    """Draws detections into an image, the best one last.

    Args:
        color: (height, width, 3) RGB.
        detections: best first.
        names: of the objects, by id.

    Returns:
        (height, width, 3) RGB.
    """
    image = color.astype(np.float32)
    for detection in reversed(detections):
        if detection.mask is not None:
            tint = np.array(_color(detection), np.float32)
            image[detection.mask] += _TINT * (tint - image[detection.mask])
    canvas = np.ascontiguousarray(image.astype(np.uint8))
    for detection in reversed(detections):
        left, top, right, bottom = (round(float(x)) for x in detection.box)
        cv2.rectangle(canvas, (left, top), (right - 1, bottom - 1), _color(detection))
        name = names.get(detection.object_id, str(detection.object_id))
        _write(canvas, f"{name} {detection.score:.2f}", left, top, _color(detection))
    return canvas


def _write(
    canvas: NDArray[np.uint8],
    text: str,
    left: int,
    bottom: int,
    color: tuple[int, int, int],
) -> None:
    """Writes above a point, or below it where there is no room, on a dark ground."""
    scale = canvas.shape[1] / 1400
    (width, height), below = cv2.getTextSize(text, _FONT, scale, 1)
    left = int(np.clip(left, 0, max(canvas.shape[1] - width, 0)))
    bottom = max(bottom - below, height + below)
    corner = (left + width, bottom + below)
    cv2.rectangle(canvas, (left, bottom - height - 1), corner, (0, 0, 0), -1)
    light = tuple(128 + c // 2 for c in color)
    cv2.putText(canvas, text, (left, bottom), _FONT, scale, light, 1, cv2.LINE_AA)


def _color(detection: Detection) -> tuple[int, int, int]:
    red, green, blue = (int(c) for c in _COLORS[detection.object_id % len(_COLORS)])
    return red, green, blue
