# SPDX-License-Identifier: MIT
"""Meshes from files, checked and put right, and even samples of their surface."""

from __future__ import annotations

import logging
import re
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from physim_drake.errors import InputError
from physim_drake.objects.closed_surface import close_holes, describe_boundary
from physim_drake.objects.mesh_assets import FolderResolver
from physim_drake.objects.mesh_limits import MAX_FACES, read_mesh_file
from physim_drake.poses import Array

MESH_SUFFIXES = (".obj", ".ply", ".stl", ".glb", ".gltf")
"""The file formats that are read, by their suffix in lower case."""

# Without a handler trimesh prints tracebacks, of a missing texture for instance.
logging.getLogger("trimesh").addHandler(logging.NullHandler())

_MERGE_DISTANCE = 1e-6  # m; vertices this close are one
_DIAMETERS = (0.005, 5.0)  # m, of objects a camera can see and a gripper can hold
_LIKELY_DIAMETERS = (0.012, 1.5)  # m; beyond these the unit is doubted
_UNITS = {"metres": 1.0, "centimetres": 1e-2, "millimetres": 1e-3}
_SHORT = {"metres": "m", "centimetres": "cm", "millimetres": "mm"}
_TYPICAL_SIZE = 0.15  # m


@dataclass(frozen=True)
class MeshReading:
    """A mesh that can be used, and what was found wrong with its file.

    Attributes:
        mesh: in O, m; vertices merged, no face twice, normals outward.
        problems: what was put right or is left wrong, a sentence each.
    """

    mesh: trimesh.Trimesh
    problems: tuple[str, ...] = ()


def read_raw_mesh(path: Path) -> trimesh.Trimesh:
    """Reads all geometry in a file as one mesh, with its texture, in file units.

    Args:
        path: an OBJ, PLY, STL or GLB file.

    Raises:
        InputError: if the file is missing, too large, or not a mesh.
    """
    data = read_mesh_file(path)
    try:
        mesh = trimesh.load(
            BytesIO(data),
            file_type=path.suffix.lower()[1:],
            resolver=FolderResolver(path.parent),
            process=False,
            force="mesh",
        )
    except Exception as error:  # trimesh raises whatever its parsers come upon
        raise InputError(
            path,
            f"is no readable mesh ({_first_line(error)})",
            "export it again as OBJ, PLY, STL or GLB",
        ) from error
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise InputError(path, "holds no triangles", "export a surface, not points")
    if path.suffix.lower() == ".ply":
        stated = re.findall(rb"^element face (\d+)", data[:65536], re.MULTILINE)
        if stated and len(mesh.faces) < int(stated[0]):
            raise InputError(
                path,
                f"is cut short: {len(mesh.faces)} of {int(stated[0])} faces",
                "copy or export it again",
                "faces",
            )
    if len(mesh.faces) > MAX_FACES:
        raise InputError(
            path, f"has {len(mesh.faces)} faces", f"reduce it below {MAX_FACES}"
        )
    return mesh


def posed_raw_mesh(
    path: Path, unit: float = 1.0, pose: Array | None = None
) -> trimesh.Trimesh:
    """Reads all geometry in a file, with its texture, posed in O, in file units.

    Args:
        path: file that `read_raw_mesh` reads.
        unit: metres per unit of the file.
        pose: X_OM (4, 4), m, of the mesh; it is in O if it is None.

    Raises:
        InputError: if the file is missing, too large, or not a mesh.
    """
    raw = read_raw_mesh(path)
    if pose is not None:
        in_units = pose.copy()
        in_units[:3, 3] /= unit
        raw.apply_transform(in_units)
    return raw


def read_mesh(path: Path, unit: float = 1.0, pose: Array | None = None) -> MeshReading:
    """Reads the surface in a file and checks that an object can be made of it.

    Args:
        path: an OBJ, PLY, STL or GLB file.
        unit: metres per unit of the file.
        pose: X_OM (4, 4), m, of the mesh; it is in O if it is None.

    Raises:
        InputError: if the file cannot be read, its values are not numbers, its size
            is not an object's, or it is flat.
    """
    raw = posed_raw_mesh(path, unit, pose)
    vertices, faces = np.asarray(raw.vertices) * unit, np.asarray(raw.faces)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(
            path,
            f"refers to vertex {faces.max()} of {len(vertices)}",
            "the file may be cut short: export it again",
            "faces",
        )
    used = vertices[np.unique(faces)]
    if not np.isfinite(used).all():
        raise InputError(
            path, "holds NaN or infinite values", "repair the mesh", "vertices"
        )
    doubts = _check_size(path, used, unit)
    spread = np.linalg.svd(used - used.mean(axis=0), compute_uv=False)
    if spread[-1] < 1e-5 * spread[0]:
        raise InputError(path, "is flat: it encloses no volume", "model a solid")
    mesh, problems = clean_mesh(vertices, faces)
    return MeshReading(mesh, (*problems, *doubts, *describe_boundary(mesh)))


def clean_mesh(vertices: Array, faces: Array) -> tuple[trimesh.Trimesh, list[str]]:
    """Merges vertices, drops repeated and empty faces, turns normals outward.

    Args:
        vertices: (V, 3), m.
        faces: (F, 3) indices.

    Returns:
        the mesh and a sentence for each thing put right.
    """
    problems = []
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.merge_vertices(digits_vertex=round(-np.log10(_MERGE_DISTANCE)))
    distinct = mesh.unique_faces()
    if not distinct.all():
        problems.append(f"{np.count_nonzero(~distinct)} faces were there twice")
    mesh.update_faces(distinct & mesh.nondegenerate_faces())
    mesh.remove_unreferenced_vertices()
    if len(mesh.faces) and not mesh.is_winding_consistent:
        mesh.fix_normals()
        left = "" if mesh.is_winding_consistent else ", and some still are not"
        problems.append(f"its faces were not turned the same way{left}")
    # The volume of an open surface depends on where the origin is.
    if (mesh if mesh.is_watertight else close_holes(mesh)).volume < 0:
        mesh.invert()
        problems.append("its faces were turned inside out")
    return mesh, problems


def diameter(mesh: trimesh.Trimesh) -> float:
    """Returns the largest distance between two points of a surface, m."""
    points = np.asarray(mesh.convex_hull.vertices)
    return max(
        float(cdist(block, points).max())
        for block in np.array_split(points, len(points) // 1000 + 1)
    )


def sample_evenly(
    mesh: trimesh.Trimesh, count: int, seed: int = 0
) -> tuple[Array, Array]:
    """Samples a surface evenly, each point the farthest from those before it.

    Farthest point sampling of a fourfold larger random sample; every beginning of the
    result is itself an even sample.

    Args:
        mesh: the surface, m.
        count: number of points N.
        seed: equal seeds give equal samples.

    Returns:
        points (N, 3), m, and their outward unit normals (N, 3).
    """
    candidates, faces = trimesh.sample.sample_surface(mesh, 4 * count, seed=seed)[:2]
    candidates = np.asarray(candidates)
    chosen = np.zeros(count, dtype=np.intp)
    distance = np.linalg.norm(candidates - candidates[0], axis=1)
    tree = KDTree(candidates)
    for i in range(1, count):
        chosen[i] = best = int(distance.argmax())
        point = candidates[best]
        # Only candidates nearer than the present largest gap can get nearer still.
        near = (
            slice(None)
            if i < 64
            else np.asarray(tree.query_ball_point(point, distance[best]))
        )
        distance[near] = np.minimum(
            distance[near], np.linalg.norm(candidates[near] - point, axis=1)
        )
    normals = np.asarray(mesh.face_normals)[faces[chosen]]
    return candidates[chosen], normals


def _check_size(path: Path, vertices: Array, unit: float) -> list[str]:
    """Refuses impossible sizes; returns a sentence about one that is doubtful."""
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    if _LIKELY_DIAMETERS[0] <= size <= _LIKELY_DIAMETERS[1]:
        return []
    used = min(_UNITS, key=lambda name: abs(_UNITS[name] - unit))
    in_unit = max(size / unit, 1e-9)
    likely = min(
        _UNITS, key=lambda name: abs(np.log(in_unit * _UNITS[name] / _TYPICAL_SIZE))
    )
    if _DIAMETERS[0] <= size <= _DIAMETERS[1]:
        if likely == used:
            return []
        return [
            f"it is {size:.3g} m across when its values are {used}. The file is likely "
            f"in {likely}: if so, write unit: {_SHORT[likely]} in a library.yaml"
        ]
    raise InputError(
        path,
        f"is {size:.3g} m across when its values are {used}",
        f"the file is likely in {likely}: scale it to {used}",
        "vertices",
    )


def _first_line(error: Exception) -> str:
    return (str(error) or type(error).__name__).strip().splitlines()[0][:120]


def resized(mesh: trimesh.Trimesh, scale: float) -> trimesh.Trimesh:
    """The mesh, larger by `scale` about its origin."""
    larger = mesh.copy()
    larger.apply_scale(scale)
    return larger
