# SPDX-License-Identifier: MIT
"""Whether the detections have the size of their models at the measured depth.

A wrong unit of the depth image or of the meshes spoils every estimate, but raises
nothing. It shows in one thing: all detections are alike too large, or too small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from physim_drake.errors import InputError
from physim_drake.objects.model import ObjectModel
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.scene_estimate import SceneEstimate

TOO_LARGE = 2.5
"""The diagonal of a true box is at most 1.41 diameters of its object, a sphere."""

TOO_SMALL = 0.35
"""Farther from 1: an object that is partly hidden, or seen end on, has a small box."""


def scale_warning(
    observation: RgbdObservation,
    detections: Sequence[Detection],
    library: Mapping[int, ObjectModel],
) -> str:
    """Says so if all detections are far too large, or all far too small.

    Args:
        observation: the image.
        detections: detections of the objects.
        library: models of the objects.

    Returns:
        what is wrong and what to check; empty if the sizes can be right.
    """
    seen = [
        (ratio, depth)
        for d in detections
        if d.seen and d.object_id in library
        for ratio, depth in _ratio_and_depth(observation, d, library[d.object_id])
    ]
    if not seen:
        return ""
    ratios, depths = np.array(seen).T
    if ratios.max() > TOO_SMALL and ratios.min() < TOO_LARGE:
        return ""
    return (
        f"at the measured depth ({np.median(depths):.2g} m) the detections are about "
        f"{np.median(ratios):.2g} times as large as their models: check the unit of "
        "the depth image (depth_scale) and of the meshes, and the intrinsics"
    )


def _ratio_and_depth(
    observation: RgbdObservation, detection: Detection, model: ObjectModel
) -> list[tuple[float, float]]:
    """The box's diagonal over the model's diameter, and the depth, m; if measured."""
    measured = observation.depth[detection.pixels(*observation.depth.shape)]
    measured = measured[measured > 0]
    if len(measured) == 0:
        return []
    depth = float(np.median(measured))
    left, top, right, bottom = detection.box
    K = observation.intrinsics
    diagonal = depth * np.hypot((right - left) / K.fx, (bottom - top) / K.fy)
    return [(float(diagonal) / model.diameter, depth)]


def with_scale_warning(estimate: SceneEstimate, warning: str) -> SceneEstimate:
    """The same estimate with a warning, which the reasons of missing objects tell."""
    if not warning:
        return estimate
    objects = tuple(
        o if o.found else replace(o, reason=f"{o.reason}; {warning}")
        for o in estimate.objects
    )
    return replace(estimate, objects=objects, warning=warning)


def error_with_scale_warning(error: InputError, warning: str) -> InputError:
    """The same error with a warning after its remedy."""
    remedy = "; ".join(text for text in (error.remedy, warning) if text)
    return InputError(error.source, error.problem, remedy, error.field)
