# SPDX-License-Identifier: MIT
"""What several looks at one scene say together."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np

from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.support_surface import SupportSurface
from physim_drake.poses import Array, transform_points
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate

_SAME_PLACE = 0.05  # m; estimates of one object that are nearer are of the same one

NOTHING_KNOWN = SceneEstimate((), SupportSurface(np.eye(4), np.eye(4)), "none", {})
"""Before the first look."""


def on_table(
    estimate: SceneEstimate,
    library: ObjectLibrary,
    in_tote: Callable[[Array], bool],
    placed: Collection[int],
) -> SceneEstimate:
    """The estimate without what is in the tote.

    Args:
        estimate: estimate of a look.
        library: models of its objects.
        in_tote: whether a point (3,) in W is in the tote.
        placed: ids of objects that were put there; one that is detected but not found
            is taken to be there.
    """
    objects = []
    for item in estimate.objects:
        if item.X_WO is None:
            if item.object_id not in placed:
                objects.append(item)
            continue
        middle = library[item.object_id].mesh.bounds.mean(axis=0)
        if not in_tote(transform_points(item.X_WO, middle[None])[0]):
            objects.append(item)
    return replace(estimate, objects=tuple(objects))


def without_object(estimate: SceneEstimate, index: int) -> SceneEstimate:
    """The estimate without one of its objects."""
    objects = estimate.objects
    return replace(estimate, objects=objects[:index] + objects[index + 1 :])


def described(estimate: SceneEstimate) -> str:
    """An estimate in one line of the log."""
    if not estimate.objects:
        return "nothing is seen on the table"
    return ", ".join(
        f"{o.name} {o.confidence:.2f}"
        if o.found
        else f"{o.name} not found ({o.reason})"
        for o in estimate.objects
    )


def merged(earlier: SceneEstimate | None, newest: SceneEstimate) -> SceneEstimate:
    """Joins the estimates of looks between which nothing was touched.

    Of an object that both know, the surer estimate is taken. What only the earlier one
    found stays: it may be hidden now, but it is still an obstacle.

    Args:
        earlier: what was known, if anything.
        newest: estimate of the newest look.
    """
    if earlier is None:
        return newest
    objects = list(newest.objects)
    for old in earlier.objects:
        match = _match(old, objects)
        if match is None:
            if old.found:
                objects.append(old)
        elif old.confidence > objects[match].confidence:
            objects[match] = old
    return replace(newest, objects=tuple(objects))


def _match(old: ObjectEstimate, objects: list[ObjectEstimate]) -> int | None:
    """Which of the newest estimates is of the same object.

    If an object occurs once in the newest look, that estimate is taken, however far off
    it is. Among several, it is the nearest one.
    """
    same = [n for n, o in enumerate(objects) if o.object_id == old.object_id]
    if len(same) <= 1:
        return same[0] if same else None
    if old.X_WO is None:
        return next((n for n in same if not objects[n].found), None)
    distances = {
        n: float(np.linalg.norm(X[:3, 3] - old.X_WO[:3, 3]))
        for n in same
        if (X := objects[n].X_WO) is not None
    }
    nearest = min(distances, key=lambda n: distances[n], default=None)
    if nearest is None or distances[nearest] > _SAME_PLACE:
        return None
    return nearest
