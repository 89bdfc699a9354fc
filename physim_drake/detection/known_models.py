# SPDX-License-Identifier: MIT
"""Tells by their sizes whether unnamed objects are those that a network knows.

Models in BOP's layout have only numbers, and a number may stand for any object.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from physim_drake.errors import InputError
from physim_drake.objects.library_files import ObjectEntry, find_objects
from physim_drake.objects.meshes import posed_raw_mesh
from physim_drake.poses import Array

_TOLERANCE = 0.005  # m, less than the difference between any two objects


def require_same_sizes(
    object_ids: Collection[int], models: Path, like: Path, source: str
) -> None:
    """Requires that objects are as large as those that a network was trained with.

    Args:
        object_ids: ids of the objects, the same in both folders.
        models: folder of their models.
        like: folder of the models that the network was trained with.
        source: name of the network in messages.

    Raises:
        InputError: if an object differs in size, or has no model.
    """
    if not object_ids:
        return
    own = {entry.object_id: entry for entry in find_objects(models)}
    others = {entry.object_id: entry for entry in find_objects(like)}
    for object_id in object_ids:
        if object_id in own and object_id in others:
            off = _extents(own[object_id]) - _extents(others[object_id])
            if np.abs(off).max() < _TOLERANCE:
                continue
        raise InputError(
            models,
            f"object {object_id} is not the one that {source} knows by this number",
            "give --weights of a network that was trained with these models, "
            "--detections FILE, or --masks",
        )


def _extents(entry: ObjectEntry) -> Array:
    """Length, width and height of an object, m, smallest first."""
    mesh = posed_raw_mesh(entry.mesh, entry.unit, entry.pose)
    return np.sort(np.ptp(np.asarray(mesh.vertices), axis=0)) * entry.unit
