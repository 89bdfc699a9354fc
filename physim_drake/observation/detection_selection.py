# SPDX-License-Identifier: MIT
"""Which of a network's detections to believe.

A network looks at each class alone, so that one thing may be detected as two objects,
and a thing may be detected as another object than it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from physim_drake.observation.observation import Detection, Mask
from physim_drake.poses import Array

SAME_THING = 0.6
"""Two detections that share more of the smaller one's pixels are of one thing."""

_SAME_BOX = 0.75
"""Two boxes of one object that share more, of what both cover, are of one thing."""

_MISTAKEN = 0.2
"""How likely a thing is another object than the network is surest of, if it also sees
that one in it: this share of what it is surer by."""

_UNSEEN = 0.05  # how likely it is that an object is not seen
_SOMETHING = 0.5  # with this score of any object, a thing may be one that is not seen


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
        counts: largest number of each object. The image shows no others.
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


def one_for_each_thing(found: Iterable[Detection]) -> list[Detection]:
    """Detections of one object, surest first, without a second one of the same thing.

    Args:
        found: detections of one object in an image.
    """
    kept: list[Detection] = []
    for detection in sorted(found, key=lambda d: -d.score):
        if not any(_same_thing(detection, other) for other in kept):
            kept.append(detection)
    return kept


def _same_thing(one: Detection, other: Detection) -> bool:
    """Whether two detections of an object are of one thing.

    Masks of two things hardly share a pixel, but boxes of two that lean on each other
    may share much.
    """
    if one.mask is not None and other.mask is not None:
        return are_nested(one.mask, other.mask, SAME_THING)
    return _shared_box(one.box, other.box) > _SAME_BOX


def _shared_box(one: Array, other: Array) -> float:
    """Intersection over union of two boxes; 0 if both are empty."""
    sides = np.minimum(one[2:], other[2:]) - np.maximum(one[:2], other[:2])
    common = float(np.prod(np.maximum(sides, 0.0)))
    union = float(np.prod(one[2:] - one[:2]) + np.prod(other[2:] - other[:2])) - common
    return common / union if union > 0 else 0.0


def assign_detections(
    found: Iterable[Detection],
    counts: Mapping[int, int],
    shape: tuple[int, int],
) -> tuple[Detection, ...]:
    """The most likely detections of objects that are known to be there.

    Every thing in the image is one object at most, so that one which the network takes
    for two goes to that which has no better, though the network be surer of the other.
    Least total cost, minus the logarithm of the scores, by the Hungarian method.

    Args:
        found: detections in an image, of all objects that the network knows.
        counts: how many of each object are there.
        shape: (height, width) of the image.

    Returns:
        one for each in the order of `counts`. Its `instead` is what else the network
        detects of the same object; of one that is not seen (`Detection.unseen`), the
        things that are not among the others.
    """
    found = sorted(found, key=lambda d: -d.score)
    things = _things(found, shape)
    wanted = [object_id for object_id, count in counts.items() for _ in range(count)]
    cost = np.full((len(wanted), len(things) + len(wanted)), -math.log(_UNSEEN))
    scores = [[_score(i, thing) for thing in things] for i in wanted]
    with np.errstate(divide="ignore"):
        cost[:, : len(things)] = -np.log(np.reshape(scores, (len(wanted), len(things))))
    _, columns = linear_sum_assignment(cost)
    left = [
        replace(thing[0], score=_MISTAKEN * thing[0].score)
        for k, thing in enumerate(things)
        if k not in columns and thing[0].score >= _SOMETHING
    ]
    assigned = []
    for object_id, k, score in zip(wanted, columns, scores, strict=True):
        if k < len(things):
            chosen = replace(things[k][0], object_id=object_id, score=score[k])
            instead = _instead(chosen, found, shape)
        else:
            chosen = Detection.unseen(object_id, *shape)
            instead = tuple(replace(d, object_id=object_id) for d in left)
        assigned.append(replace(chosen, instead=instead))
    return tuple(assigned)


def _instead(
    chosen: Detection,
    found: Iterable[Detection],
    shape: tuple[int, int],
) -> tuple[Detection, ...]:
    """Where else the network sees an object, the likeliest first."""
    pixels = chosen.pixels(*shape)
    return tuple(
        d
        for d in found
        if d.object_id == chosen.object_id
        and d.score >= _UNSEEN
        and not are_nested(d.pixels(*shape), pixels, SAME_THING)
    )


def _things(
    found: Iterable[Detection], shape: tuple[int, int]
) -> list[list[Detection]]:
    """The detections of each thing, surest first as they are given.

    Those of one class are of several things: the network has seen to that.
    """
    things: list[tuple[Mask, list[Detection]]] = []
    for detection in found:
        pixels = detection.pixels(*shape)
        if not pixels.any():
            continue
        for mask, of_thing in things:
            alike = any(d.object_id == detection.object_id for d in of_thing)
            if not alike and are_nested(pixels, mask, SAME_THING):
                of_thing.append(detection)
                break
        else:
            things.append((pixels, [detection]))
    return [of_thing for _, of_thing in things]


def _score(object_id: int, thing: list[Detection]) -> float:
    """How likely a thing is this object; 0 if the network does not see it there."""
    own = next((d.score for d in thing if d.object_id == object_id), None)
    return 0.0 if own is None else own + _MISTAKEN * (thing[0].score - own)


def are_nested(one: Mask, other: Mask, overlap: float) -> bool:
    """Whether two masks share more than this of the smaller one's pixels."""
    smaller = min(np.count_nonzero(one), np.count_nonzero(other))
    return bool(np.count_nonzero(one & other) > overlap * smaller)


def _shared(one: Mask, other: Mask) -> float:
    """Intersection over union of two masks that are not both empty."""
    return float(np.count_nonzero(one & other) / np.count_nonzero(one | other))
