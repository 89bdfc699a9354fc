# SPDX-License-Identifier: MIT
"""What aligning, settling and refining need of an object's shape, made once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from physim_drake.objects.model import ObjectModel
from physim_drake.objects.symmetry import near_symmetries
from physim_drake.poses import Array
from physim_drake.registration.distance_field import DistanceField, build_distance_field

SURFACE_POINTS = 450

NEARLY = 0.1
"""Of the diameter: a turned object whose surface is off by less looks much the same."""


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


@lru_cache(maxsize=256)
def lookalike_turns(model: ObjectModel) -> Array:
    """The motions X_OO' (K, 4, 4) after which an object looks much the same."""
    return near_symmetries(model.mesh, NEARLY * model.diameter, model.symmetry)
