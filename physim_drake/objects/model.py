# SPDX-License-Identifier: MIT
"""The known objects: surface, symmetry, mass and collision geometry of each.

Object frame O is the frame of the mesh file; everything is in metres and kilograms.
`ObjectLibrary.load` reads the layouts that `library_files` describes.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from physim_drake.errors import InputError
from physim_drake.objects import meshes
from physim_drake.objects.closed_surface import closed_copy
from physim_drake.objects.convex_pieces import convex_pieces
from physim_drake.objects.library_files import (
    DEFAULT_FRICTION,
    ObjectEntry,
    find_objects,
)
from physim_drake.objects.mesh_assets import find_texture
from physim_drake.objects.symmetry import detect_symmetry
from physim_drake.poses import Array, SymmetryGroup

DEFAULT_DENSITY = 600.0
"""kg/m^3, between a box of tissues and a bottle of water."""


@dataclass(frozen=True, eq=False)
class ObjectModel:
    """One known object; compare by `object_id`.

    Attributes:
        object_id: its number in the library.
        name: its name.
        mesh: visual surface in O, m, vertices merged, normals outward; may be open.
        symmetry: the motions that map it onto itself.
        mass: kg.
        center_of_mass: (3,), m, in O.
        inertia: (3, 3), kg m^2, about the centre of mass, axes of O.
        friction: coefficient of friction, static and dynamic.
        source: the file the mesh was read from.
        source_unit: metres per unit of that file.
        source_pose: X_OM (4, 4), m, of that file's frame M; None if it is O.
        texture: image of the visual's texture, if there is one.
        given_pieces: convex pieces that were given with the object, in O, m.
        problems: what is wrong with the mesh file, a sentence each.
    """

    object_id: int
    name: str
    mesh: trimesh.Trimesh
    symmetry: SymmetryGroup
    mass: float
    center_of_mass: Array
    inertia: Array
    friction: float = DEFAULT_FRICTION
    source: Path = Path()
    source_unit: float = 1.0
    source_pose: Array | None = None
    texture: Path | None = None
    given_pieces: tuple[trimesh.Trimesh, ...] = ()
    problems: tuple[str, ...] = ()
    _samples: dict[tuple[int, int], tuple[Array, Array]] = field(
        default_factory=dict, repr=False
    )

    @classmethod
    def from_mesh(
        cls,
        object_id: int,
        name: str,
        mesh: trimesh.Trimesh,
        *,
        symmetry: SymmetryGroup | None = None,
        mass: float | None = None,
        friction: float = DEFAULT_FRICTION,
        given_pieces: tuple[trimesh.Trimesh, ...] = (),
    ) -> ObjectModel:
        """Makes a model of a mesh in memory.

        Args:
            object_id: its number.
            name: its name.
            mesh: surface in O, m; it may be open.
            symmetry: found from the shape if it is None.
            mass: kg; from the volume and `DEFAULT_DENSITY` if it is None.
            friction: coefficient of friction.
            given_pieces: convex pieces in O, m; computed when needed if empty.
        """
        solid = _solid(closed_copy(mesh))
        mass = DEFAULT_DENSITY * float(solid.volume) if mass is None else mass
        return cls(
            object_id,
            name,
            mesh,
            detect_symmetry(mesh) if symmetry is None else symmetry,
            mass,
            np.array(solid.center_mass),
            np.array(solid.moment_inertia) * mass / float(solid.volume),
            friction,
            given_pieces=given_pieces,
        )

    @cached_property
    def solid(self) -> trimesh.Trimesh:
        """The surface with an inside, in O, m: a closed copy if `mesh` is open."""
        return closed_copy(self.mesh)

    @cached_property
    def collision_pieces(self) -> tuple[trimesh.Trimesh, ...]:
        """Convex pieces in O, m; computed at first use if none were given."""
        return self.given_pieces or convex_pieces(self.solid)

    @cached_property
    def diameter(self) -> float:
        """Largest distance between two points of the surface, m."""
        return meshes.diameter(self.mesh)

    def resized(self, scale: float) -> ObjectModel:
        """The same object, larger by `scale` and as dense."""
        return replace(
            self,
            mesh=meshes.resized(self.mesh, scale),
            symmetry=self.symmetry.resized(scale),
            mass=self.mass * scale**3,
            center_of_mass=self.center_of_mass * scale,
            inertia=self.inertia * scale**5,
            given_pieces=tuple(meshes.resized(p, scale) for p in self.given_pieces),
            _samples={},
        )

    @property
    def extents(self) -> Array:
        """Size along the axes of O, (3,), m."""
        return np.array(self.mesh.extents)

    def surface_sample(self, count: int, seed: int = 0) -> tuple[Array, Array]:
        """Samples the surface evenly; the same arguments give the same sample.

        Args:
            count: number of points N.
            seed: of the random choice.

        Returns:
            points p_OP (N, 3), m, and outward unit normals (N, 3); do not write to
            them, they are kept for the next call.
        """
        key = (count, seed)
        if key not in self._samples:
            sample = meshes.sample_evenly(self.mesh, count, seed)
            for array in sample:
                array.flags.writeable = False
            self._samples[key] = sample
        return self._samples[key]


class ObjectLibrary(Mapping[int, ObjectModel]):
    """The known objects by their id.

    Args:
        models: the objects.
        source: what messages call the library, for instance its folder.
    """

    def __init__(self, models: Collection[ObjectModel], source: Path | str) -> None:
        self._models = {model.object_id: model for model in models}
        self.source = str(source)

    @classmethod
    def load(
        cls, folder: str | Path, object_ids: Collection[int] | None = None
    ) -> ObjectLibrary:
        """Reads the objects of a folder.

        Args:
            folder: with a `library.yaml`, a BOP models folder, or loose meshes.
            object_ids: the objects to read; all if it is None.

        Raises:
            InputError: if the folder, an object asked for, or a mesh is missing or
                cannot be used.
        """
        folder = Path(folder)
        entries = {entry.object_id: entry for entry in find_objects(folder)}
        wanted = list(entries) if object_ids is None else sorted(set(object_ids))
        for object_id in wanted:
            if object_id not in entries:
                raise _missing(folder, object_id, list(entries))
        return cls([read_model(entries[i]) for i in wanted], folder)

    @property
    def ids(self) -> tuple[int, ...]:
        """The ids in order."""
        return tuple(sorted(self._models))

    def by_name(self, name: str) -> ObjectModel:
        """Returns the object called `name`.

        Raises:
            InputError: if there is none.
        """
        for model in self._models.values():
            if model.name == name:
                return model
        known = ", ".join(model.name for model in self._models.values())
        raise InputError(self.source, f"has no object {name!r}", f"it has {known}")

    def __getitem__(self, object_id: int) -> ObjectModel:
        try:
            return self._models[object_id]
        except KeyError:
            raise _missing(self.source, object_id, self.ids) from None

    def get(self, object_id: int, default: Any = None) -> Any:
        """Returns the object with this id, or `default`."""
        return self._models.get(object_id, default)

    def __contains__(self, object_id: object) -> bool:
        return object_id in self._models

    def __iter__(self) -> Iterator[int]:
        return iter(self.ids)

    def __len__(self) -> int:
        return len(self._models)


def read_model(entry: ObjectEntry) -> ObjectModel:
    """Reads the files of one object.

    Raises:
        InputError: if a mesh is missing or cannot be used.
    """
    reading = meshes.read_mesh(entry.mesh, entry.unit, entry.pose)
    pieces = tuple(
        meshes.read_mesh(path, entry.unit).mesh.convex_hull for path in entry.collision
    )
    model = ObjectModel.from_mesh(
        entry.object_id,
        entry.name,
        reading.mesh,
        symmetry=entry.symmetry,
        mass=entry.mass,
        friction=entry.friction,
        given_pieces=pieces,
    )
    if entry.inertia is not None:
        given = entry.inertia
        model = replace(
            model, center_of_mass=given.center_of_mass, inertia=given.inertia
        )
    return replace(
        model,
        source=entry.mesh,
        source_unit=entry.unit,
        source_pose=entry.pose,
        texture=find_texture(entry.mesh),
        problems=reading.problems,
    )


def _solid(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh if its volume can be trusted, else its convex hull."""
    hull = mesh.convex_hull
    trusted = mesh.is_watertight or 0.05 < mesh.volume / hull.volume <= 1.0
    return mesh if trusted and mesh.volume > 1e-3 * hull.volume else hull


def _missing(source: Path | str, object_id: int, ids: Collection[int]) -> InputError:
    known = ", ".join(str(i) for i in sorted(ids))
    return InputError(source, f"has no object with id {object_id}", f"it has {known}")
