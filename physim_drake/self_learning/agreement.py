# SPDX-License-Identifier: MIT
"""Objects whose poses several views of one scene agree on.

A pose from a single view may be wrong however sure it looks, since from one side a
wrong or a turned object can fit the depth as well. Two views rarely err alike, and
some view sees through an object that is not there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physim_drake.objects.model import ObjectLibrary, ObjectModel
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.pose_errors import pose_error
from physim_drake.poses import Array, transform_points
from physim_drake.scene_estimate import ObjectEstimate

_TOUCHING = 0.8  # of the distance at which two balls inside the objects touch


@dataclass(frozen=True)
class EstimatedView:
    """One view of a scene and what was made of it alone.

    Attributes:
        observation: image with a known X_WC.
        detections: detections in the image.
        estimates: poses in the world of some of the detections.
    """

    observation: RgbdObservation
    detections: tuple[Detection, ...]
    estimates: tuple[ObjectEstimate, ...]


@dataclass(frozen=True)
class AgreementConfig:
    """Limits within which views agree.

    Attributes:
        min_confidence: confidence below which estimates do not count.
        max_rotation: angle between two estimates of one object, symmetries considered,
            rad.
        max_distance: distance between them, m.
        min_views: number of views that must agree.
    """

    min_confidence: float = 0.7
    max_rotation: float = float(np.radians(8.0))
    max_distance: float = 0.01
    min_views: int = 2


@dataclass(frozen=True)
class AgreedObject:
    """An object that several views put in the same place.

    Attributes:
        object_id: id of the object.
        X_WO: pose that the most confident view estimates, (4, 4), m.
        confidence: confidence of that estimate, 0..1.
        views: numbers of the views that agree.
    """

    object_id: int
    X_WO: Array
    confidence: float
    views: tuple[int, ...]


def agreed_objects(
    views: Sequence[EstimatedView],
    library: ObjectLibrary,
    config: AgreementConfig = AgreementConfig(),
) -> tuple[AgreedObject, ...]:
    """Finds the objects on which views agree.

    If one object would be inside another, the one that more views agree on is taken,
    then the more confident one.

    Args:
        views: views of one scene, which did not change between them.
        library: models of the objects.
        config: limits of agreement.

    Returns:
        the objects, those of most views first.
    """
    candidates = [
        AgreedObject(e.object_id, e.X_WO, e.confidence, (n,))
        for n, view in enumerate(views)
        for e in view.estimates
        if e.X_WO is not None and e.confidence >= config.min_confidence
    ]
    supported = [
        AgreedObject(
            c.object_id,
            c.X_WO,
            c.confidence,
            tuple(
                sorted({o.views[0] for o in candidates if agree(c, o, library, config)})
            ),
        )
        for c in candidates
    ]
    supported.sort(key=lambda c: (-len(c.views), -c.confidence))
    agreed: list[AgreedObject] = []
    for candidate in supported:
        if len(candidate.views) < config.min_views:
            break
        if not any(_overlap(candidate, other, library) for other in agreed):
            agreed.append(candidate)
    return tuple(agreed)


def agree(
    one: AgreedObject, other: AgreedObject, library: ObjectLibrary, c: AgreementConfig
) -> bool:
    """Whether two estimates are of one object at one pose, symmetries considered."""
    if one.object_id != other.object_id:
        return False
    error = pose_error(one.X_WO, other.X_WO, library[one.object_id].symmetry)
    return error.within(c.max_rotation, c.max_distance)


def _overlap(one: AgreedObject, other: AgreedObject, library: ObjectLibrary) -> bool:
    """Whether the middles are nearer than those of two solids can be.

    Half its least extent is the radius of a ball that fits inside a convex object.
    """
    models = library[one.object_id], library[other.object_id]
    least = sum(float(model.extents.min()) / 2 for model in models)
    middles = _middle(models[0], one.X_WO), _middle(models[1], other.X_WO)
    return float(np.linalg.norm(middles[0] - middles[1])) < _TOUCHING * least


def _middle(model: ObjectModel, X_WO: Array) -> Array:
    middle = model.mesh.bounds.mean(axis=0)
    return np.asarray(transform_points(X_WO, middle[None])[0])
