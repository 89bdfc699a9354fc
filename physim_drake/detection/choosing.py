# SPDX-License-Identifier: MIT
"""Which of a network's detections to believe, where no list of targets decides.

A network looks at each class alone, so that one thing may be detected as two.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from physim_drake.observation import Detection, Mask


@dataclass(frozen=True)
class ChoiceConfig:
    """What is believed.

    Attributes:
        least_score: less certain detections are dropped.
        min_pixels: so are those of which less shows.
        overlap: so are those that share more than this with a surer one, of the
            pixels that both have together.
    """

    least_score: float = 0.5
    min_pixels: int = 100
    overlap: float = 0.6


def choose_detections(
    found: Iterable[Detection],
    counts: Mapping[int, int],
    shape: tuple[int, int],
    config: ChoiceConfig = ChoiceConfig(),
) -> tuple[Detection, ...]:
    """The detections to believe, surest first.

    Args:
        found: detections in an image.
        counts: how many there may be of each object; of others there are none.
        shape: (height, width) of the image.
        config: what is believed.
    """
    chosen: list[Detection] = []
    taken: list[Mask] = []
    left = dict(counts)
    for detection in sorted(found, key=lambda d: -d.score):
        pixels = detection.pixels(*shape)
        if (
            detection.score < config.least_score
            or left.get(detection.object_id, 0) < 1
            or np.count_nonzero(pixels) < config.min_pixels
            or any(_shared(pixels, other) > config.overlap for other in taken)
        ):
            continue
        left[detection.object_id] -= 1
        chosen.append(detection)
        taken.append(pixels)
    return tuple(chosen)


def _shared(one: Mask, other: Mask) -> float:
    """Intersection over union of two masks that are not both empty."""
    return float(np.count_nonzero(one & other) / np.count_nonzero(one | other))
