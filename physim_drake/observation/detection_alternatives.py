# SPDX-License-Identifier: MIT
"""Other places for objects that a network is not sure of.

In the dark, or if little of a thing shows, a network may take two things for each
other, or one for something else. It still sees them, if with a lower score. The depth
image tells better which is which.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from physim_drake.observation.detection_selection import SAME_THING, are_nested
from physim_drake.observation.observation import Detection

UNSURE_BELOW = 0.5
"""Only objects that are detected with less than this score are moved elsewhere."""


def rival_choices(
    detections: Sequence[Detection], shape: tuple[int, int], most: int = 3
) -> list[tuple[Detection, ...]]:
    """Other detections of the same objects, the likeliest first.

    In each choice, one unsure object takes another place where the network sees it, and
    those that were detected there take other places where it sees them.

    Args:
        detections: of one image; nothing else is known of those without `instead`.
        shape: (height, width) of the image.
        most: number of choices at most.
    """
    choices = [
        choice
        for k, detection in enumerate(detections)
        if detection.score < UNSURE_BELOW
        for place in detection.instead
        if (choice := _moved(detections, k, place, shape))
    ]
    choices.sort(key=lambda choice: -math.prod(d.score for d in choice))
    return choices[:most]


def _moved(
    detections: Sequence[Detection],
    index: int,
    place: Detection,
    shape: tuple[int, int],
) -> tuple[Detection, ...]:
    """The detections with one elsewhere; none if another has nowhere to go."""

    def same(one: Detection, other: Detection) -> bool:
        return are_nested(one.pixels(*shape), other.pixels(*shape), SAME_THING)

    choice = list(detections)
    choice[index] = place
    for k, detection in enumerate(detections):
        if k == index or not same(detection, place):
            continue
        others = [d for n, d in enumerate(choice) if n != k]
        free = [
            other
            for other in detection.instead
            if not any(same(other, taken) for taken in others)
        ]
        if not free:
            return ()
        choice[k] = free[0]
    return tuple(choice)
