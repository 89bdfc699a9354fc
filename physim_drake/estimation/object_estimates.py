# SPDX-License-Identifier: MIT
"""The report on each object: its pose in camera and world, or why it was not found."""

from __future__ import annotations

import math
from collections.abc import Mapping

from physim_drake.estimation.config import EstimationConfig
from physim_drake.estimation.preparation import PreparedScene
from physim_drake.estimation.scene_search import SearchedScene
from physim_drake.objects.model import ObjectModel
from physim_drake.observation.observation import Segment
from physim_drake.poses import nearest_rotation
from physim_drake.scene_estimate import ObjectEstimate


def object_estimates(
    prepared: PreparedScene,
    searched: SearchedScene,
    confidences: Mapping[int, float],
    library: Mapping[int, ObjectModel],
    config: EstimationConfig,
) -> tuple[ObjectEstimate, ...]:
    """One estimate for each detection, in its order.

    Args:
        prepared: the image.
        searched: poses that were found in it.
        confidences: confidence of each object that was placed, 0..1, by its index in
            the scene.
        library: models of the objects.
        config: settings, of which the required confidence is used.
    """
    estimates = []
    for k, segment in enumerate(prepared.segmented.segments):
        excluded = k in searched.excluded
        reason = _why_not_found(segment, confidences.get(k), excluded, config)
        if reason:
            name = library[segment.object_id].name
            missing = ObjectEstimate(segment.object_id, name, None, None, 0.0, reason)
            estimates.append(missing)
        else:
            confidence = confidences[k] * searched.shares.get(k, 1.0)
            estimates.append(_found(prepared, searched, k, confidence, library))
    return tuple(estimates)


def _found(
    prepared: PreparedScene,
    searched: SearchedScene,
    k: int,
    confidence: float,
    library: Mapping[int, ObjectModel],
) -> ObjectEstimate:
    """The estimate of an object that was found."""
    object_id = prepared.segmented.segments[k].object_id
    X_WC = prepared.observation.X_WC
    X_SO = searched.placed[k].copy()
    X_SO[:3, :3] = nearest_rotation(X_SO[:3, :3])
    X_CO = prepared.segmented.X_CS @ X_SO
    X_WO = prepared.surface.X_WS @ X_SO if X_WC is None else X_WC @ X_CO
    name = library[object_id].name
    return ObjectEstimate(object_id, name, X_CO, X_WO, confidence, "")


def _why_not_found(
    segment: Segment,
    confidence: float | None,
    excluded: bool,
    config: EstimationConfig,
) -> str:
    """Empty if it is found; `confidence` is None if it has no pose.

    What is not shared yet counts: an object that is there is found, though it may be
    turned the other way.
    """
    if not segment.detection.seen:
        return "the detector did not see it"
    if excluded:
        return "no pose of it fits beside the other objects"
    if confidence is None:
        count, least = len(segment.points), config.min_segment_points
        if count < least:
            return f"its segment has {count} points, at least {least} are needed"
        return "no pose of it fits its segment"
    required = config.required_confidence
    if confidence < required:  # rounded down, to be below in print as well
        shown = math.floor(100 * confidence) / 100
        return f"confidence {shown:.2f} is below {required:.2f}"
    return ""
