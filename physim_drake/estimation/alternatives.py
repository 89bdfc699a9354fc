# SPDX-License-Identifier: MIT
"""Which objects the detector took for each other, tried out.

If a detector is not sure of an object, and neither is the image of its pose, the object
is tried where else the detector sees it; what the image confirms most is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from physim_drake.estimation.config import EstimationConfig
from physim_drake.observation.detection_alternatives import UNSURE_BELOW, rival_choices
from physim_drake.observation.observation import Detection
from physim_drake.scene_estimate import SceneEstimate


def best_alternative(
    estimate: Callable[[Sequence[Detection]], SceneEstimate],
    detections: Sequence[Detection],
    shape: tuple[int, int],
    config: EstimationConfig,
) -> SceneEstimate:
    """The estimate with those detections of which the image confirms most.

    Args:
        estimate: makes one, with detections in the order of `detections`.
        detections: likeliest place of each object.
        shape: (height, width) of the image.
        config: settings of the estimates; a method that does not search tries no
            alternatives.

    Returns:
        the best estimate; its stages' seconds are those of all that were made.
    """
    best = estimate(detections)
    if not config.method.searches:
        return best
    stages = dict(best.stages)
    for choice in rival_choices(detections, shape):
        if _settled(best, config):
            break
        other = estimate(choice)
        for stage, seconds in other.stages.items():
            stages[stage] = stages.get(stage, 0.0) + seconds
        if _confirms(other, detections, config):
            best = max(best, other, key=_explained)
    return replace(best, stages=stages)


def _settled(estimate: SceneEstimate, config: EstimationConfig) -> bool:
    """Whether the detector or the image is sure of each object."""
    return all(
        d.score >= UNSURE_BELOW or o.confidence >= config.alternatives_below
        for d, o in zip(estimate.detections, estimate.objects, strict=True)
    )


def _confirms(
    estimate: SceneEstimate, detections: Sequence[Detection], config: EstimationConfig
) -> bool:
    """Whether it is sure of all objects that the detector did not see."""
    return all(
        d.seen or not o.found or o.confidence >= config.confident_from
        for d, o in zip(detections, estimate.objects, strict=True)
    )


def _explained(estimate: SceneEstimate) -> float:
    """How much of the estimate the image confirms, in objects."""
    return sum(o.confidence for o in estimate.objects)
