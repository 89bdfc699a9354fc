# SPDX-License-Identifier: MIT
"""What aligning, settling and refining need of an object's shape, made once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from physim_drake.distance_field import DistanceField, build_distance_field
from physim_drake.objects import ObjectModel
from physim_drake.poses import Array

SURFACE_POINTS = 450


@dataclass(frozen=True)
class RegistrationModel:
    """An object's shape, tabulated.

    Attributes:
        distance_field: signed distance to the surface.
        points: an even sample of the surface, p_O (N, 3), m.
        normals: its outward normals, (N, 3).
    """

    distance_field: DistanceField
    points: Array
    normals: Array


@lru_cache(maxsize=256)
def registration_model(model: ObjectModel) -> RegistrationModel:
    """Tabulates an object; the last 256 are kept."""
    points, normals = model.surface_sample(SURFACE_POINTS)
    return RegistrationModel(build_distance_field(model.mesh), points, normals)
