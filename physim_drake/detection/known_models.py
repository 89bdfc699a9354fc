# SPDX-License-Identifier: MIT
"""Whether objects without names are those that a network knows: by their sizes.

Models in BOP's layout have numbers only, and the same number may be any object.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from physim_drake.errors import InputError
from physim_drake.objects.library_files import ObjectEntry, find_objects
from physim_drake.objects.meshes import read_raw_mesh
from physim_drake.poses import Array

_TOLERANCE = 0.005  # m; less than what tells different objects apart


def check_sizes(
    object_ids: Collection[int], models: Path, like: Path, source: str
) -> None:
    """Sees whether objects are as large as those of the same ids elsewhere.

    Args:
        object_ids: which objects.
        models: folder of their models.
        like: folder of the models that a network was trained with.
        source: what to call the network.

    Raises:
        InputError: where one is not, or has no model.
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
    mesh = read_raw_mesh(entry.mesh)
    return np.sort(np.ptp(np.asarray(mesh.vertices), axis=0)) * entry.unit
