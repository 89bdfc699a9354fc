# SPDX-License-Identifier: MIT
"""What is known of an object before its mesh is read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from physim_drake.poses import Array, SymmetryGroup

DEFAULT_FRICTION = 0.8


@dataclass(frozen=True)
class GivenInertia:
    """The inertia that a description states.

    Attributes:
        center_of_mass: (3,), m, in O.
        inertia: (3, 3), kg m^2, about the centre of mass, axes of O.
    """

    center_of_mass: Array
    inertia: Array


@dataclass(frozen=True, eq=False)
class ObjectEntry:
    """What is known of an object before its mesh is read.

    Attributes:
        object_id: its number.
        name: its name.
        mesh: the file with its surface.
        unit: metres per unit of that file and of the convex pieces.
        collision: files with convex pieces.
        mass: kg, or None if it is not known.
        friction: coefficient of friction.
        symmetry: None if it is to be found from the shape.
        pose: X_OM (4, 4), m, of the mesh's own frame M; None if it is O.
        inertia: None if it is to be found from the shape and the mass.
    """

    object_id: int
    name: str
    mesh: Path
    unit: float = 1.0
    collision: tuple[Path, ...] = ()
    mass: float | None = None
    friction: float = DEFAULT_FRICTION
    symmetry: SymmetryGroup | None = None
    pose: Array | None = None
    inertia: GivenInertia | None = None
