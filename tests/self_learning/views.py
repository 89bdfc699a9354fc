# SPDX-License-Identifier: MIT
"""Views of synthetic scenes from several sides, and estimates made of the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from physim_drake.observation.observation import RgbdObservation
from physim_drake.poses import Array, inverse
from physim_drake.scene_estimate import ObjectEstimate
from physim_drake.self_learning.agreement import EstimatedView
from physim_drake.self_learning.projection import ObjectArea
from tests.synthetic import Objects, SyntheticScene, library, look_at, synthesize

CAMERAS = (
    look_at([0.05, -0.45, 0.55], [0.0, 0.0, 0.04]),
    look_at([0.45, 0.10, 0.55], [0.0, 0.0, 0.04]),
    look_at([-0.30, 0.35, 0.50], [0.0, 0.0, 0.04]),
)
AREA = ObjectArea(np.eye(4), np.array([0.25, 0.25]))


def seen_from(objects: Objects, X_WC: Array) -> tuple[SyntheticScene, RgbdObservation]:
    """A scene and its image, with colours that say nothing."""
    scene = synthesize(objects, X_WC=X_WC)
    color = np.full((*scene.observation.depth.shape, 3), 120, np.uint8)
    color[..., 0] = np.arange(color.shape[1]) % 256
    return scene, replace(scene.observation, color=color)


def view_of(
    objects: Objects,
    X_WC: Array,
    estimated: Sequence[tuple[int, Array]],
    confidence: float = 0.95,
) -> EstimatedView:
    """A view in which some objects were detected, with the poses that are given."""
    scene, observation = seen_from(objects, X_WC)
    ids = [i for i, _ in estimated]
    detections = tuple(d for d in scene.detections if d.object_id in ids)
    return EstimatedView(
        observation,
        detections,
        tuple(estimate(i, X, X_WC, confidence) for i, X in estimated),
    )


def estimate(
    object_id: int, X_WO: Array, X_WC: Array = CAMERAS[0], confidence: float = 0.95
) -> ObjectEstimate:
    """An object that was found."""
    name = library()[object_id].name
    return ObjectEstimate(object_id, name, inverse(X_WC) @ X_WO, X_WO, confidence, "")
