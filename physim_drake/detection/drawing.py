# SPDX-License-Identifier: MIT
"""Pictures of detections: each mask tinted, boxed and named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import matplotlib
import numpy as np
from numpy.typing import NDArray

from physim_drake.observation.observation import Detection
from physim_drake.rendering.captions import Captions

_COLORS = (matplotlib.colormaps["tab20"](np.arange(20))[:, :3] * 255).astype(int)
_TINT = 0.45


def draw_detections(
    color: NDArray[np.uint8],
    detections: Sequence[Detection],
    names: Mapping[int, str],
) -> NDArray[np.uint8]:
    """Draws detections into an image, the best one upon the others.

    Args:
        color: (height, width, 3) RGB.
        detections: detections to draw, best first.
        names: names of the objects, by id.

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
    captions = Captions(canvas)
    for detection in detections:
        left, top = (round(float(x)) for x in detection.box[:2])
        name = names.get(detection.object_id, str(detection.object_id))
        text = f"{name} {detection.score:.2f}"
        captions.write(text, left, top, _color(detection), centred=False)
    return canvas


def _color(detection: Detection) -> tuple[int, int, int]:
    red, green, blue = (int(c) for c in _COLORS[detection.object_id % len(_COLORS)])
    return red, green, blue
