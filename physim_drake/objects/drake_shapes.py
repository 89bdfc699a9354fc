# SPDX-License-Identifier: MIT
"""Meshes as Drake's shapes, held in memory."""

from __future__ import annotations

from typing import cast

import trimesh
from pydrake.common import MemoryFile
from pydrake.geometry import Convex, InMemoryMesh, Mesh
from trimesh.exchange.obj import export_obj

from physim_drake.objects.model import ObjectModel


def collision_shapes(model: ObjectModel) -> tuple[Convex, ...]:
    """The convex pieces of an object, in O."""
    return tuple(
        Convex(obj_in_memory(_obj_text(piece), f"{model.name}_{n}"))
        for n, piece in enumerate(model.collision_pieces)
    )


def mesh_shape(mesh: trimesh.Trimesh, name: str) -> Mesh:
    """The shape of `mesh` (metres), with normals, for renderers."""
    text = export_obj(
        mesh, include_normals=True, include_texture=False, include_color=False
    )
    return Mesh(obj_in_memory(text, name))


def _obj_text(piece: trimesh.Trimesh) -> str:
    return cast(str, piece.export(file_type="obj"))


def obj_in_memory(text: str, name: str) -> InMemoryMesh:
    """A mesh that Drake parses from the text of an OBJ file.

    Args:
        text: content of the file.
        name: stem of the file name that messages give.
    """
    return InMemoryMesh(mesh_file=MemoryFile(text, ".obj", f"{name}.obj"))
