# SPDX-License-Identifier: MIT
"""The data about an object's shape that registration and settling use, made once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from physim_drake.objects.model import ObjectModel
from physim_drake.objects.symmetry import near_symmetries
from physim_drake.poses import Array
from physim_drake.registration.distance_field import DistanceField, build_distance_field

SURFACE_POINTS = 450

NEARLY = 0.1
"""Share of the diameter. A turn that moves the surface by less leaves its looks."""


@dataclass(frozen=True)
class RegistrationModel:
    """An object's shape, tabulated.

    Attributes:
        distance_field: signed distance to the surface.
        points: points p_O spread evenly over the surface, (N, 3), m.
        normals: outward normals at the points, (N, 3).
    """

    distance_field: DistanceField
    points: Array
    normals: Array


@lru_cache(maxsize=256)
def registration_model(model: ObjectModel) -> RegistrationModel:
    """Tabulates an object. The last 256 are kept."""
    points, normals = model.surface_sample(SURFACE_POINTS)
    return RegistrationModel(
        build_distance_field(model.mesh, model.solid), points, normals
    )


@lru_cache(maxsize=256)
def lookalike_turns(model: ObjectModel) -> Array:
    """The motions X_OO' (K, 4, 4) after which an object looks much the same."""
    return near_symmetries(model.mesh, NEARLY * model.diameter, model.symmetry)
