# SPDX-License-Identifier: MIT
"""Convex pieces for contact: a hull where it fits, else a convex decomposition.

Drake's compliant hydroelastic contact takes convex pieces only (it turns any mesh into
its hull without a word), and its cost grows with the number of faces of a piece.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from physim_drake.errors import InputError
from physim_drake.objects.surface_distance import signed_distances
from physim_drake.poses import Array
from physim_drake.storage.files import write_atomically

MAX_HULL_FACES = 80
"""Faces of a piece before simplification is tried (cost per step grows with them)."""

HULL_TOLERANCE = 1e-3
"""A simplified hull leaves the exact one by at most this, m."""

_CONVEX_VOLUME = 0.97  # of the hull; below it, holes and dents matter
_CONVEX_DISTANCE = 1e-3  # m, hull to surface, exceeded by at most 5 % of the hull
_CACHE_VERSION = b"coacd 0.1/30/1000/60"  # change it with the settings below
_FINE_CACHE_VERSION = b"coacd 0.1/on 20/1000/10/20"  # of the settings for fine meshes
_FINE_FACES = 20_000
_COACD_THRESHOLD = 0.1  # concavity that is left, on a unit scale


def convex_pieces(
    mesh: trimesh.Trimesh, max_faces: int = MAX_HULL_FACES
) -> tuple[trimesh.Trimesh, ...]:
    """Covers a solid with convex pieces.

    The convex hull if the solid is nearly convex; else the approximate convex
    decomposition of Wei et al. (CoACD, SIGGRAPH 2022), which takes seconds and is kept
    in the user's cache folder.

    Args:
        mesh: closed surface, m.
        max_faces: a piece is simplified towards this number of faces, as far as
            `HULL_TOLERANCE` allows.

    Returns:
        watertight convex meshes, m, in the frame of `mesh`.
    """
    hull = mesh.convex_hull
    if is_nearly_convex(mesh, hull):
        return (simplify_hull(hull, max_faces),)
    key = hashlib.sha256(
        (_FINE_CACHE_VERSION if len(mesh.faces) > _FINE_FACES else _CACHE_VERSION)
        + np.ascontiguousarray(mesh.vertices, dtype=np.float64).tobytes()
        + np.ascontiguousarray(mesh.faces, dtype=np.int64).tobytes()
    ).hexdigest()
    clouds = _load_cached(key)
    if clouds is None:
        clouds = _decompose(mesh)
        _store_cached(key, clouds)
    pieces = (trimesh.Trimesh(cloud).convex_hull for cloud in clouds)
    return tuple(simplify_hull(piece, max_faces) for piece in pieces)


def is_nearly_convex(mesh: trimesh.Trimesh, hull: trimesh.Trimesh) -> bool:
    """Whether the hull of a solid can stand for it in contact.

    Args:
        mesh: the surface, m.
        hull: its convex hull.
    """
    if mesh.is_watertight and mesh.volume > _CONVEX_VOLUME * hull.volume:
        return True
    return surface_distance(hull, mesh, 95.0) < _CONVEX_DISTANCE


def surface_distance(
    start: trimesh.Trimesh, end: trimesh.Trimesh, percentile: float = 100.0
) -> float:
    """Percentile of the distances from points of one surface to another, m.

    Args:
        start: the surface that is sampled, m.
        end: the surface that distances are taken to, m.
        percentile: 100 for the largest.
    """
    points, _ = trimesh.sample.sample_surface(start, 2000, seed=0)[:2]
    distances = np.abs(signed_distances(end, np.asarray(points)))
    return float(np.percentile(distances, percentile))


def pieces_deviation(
    pieces: tuple[trimesh.Trimesh, ...], mesh: trimesh.Trimesh
) -> float:
    """Largest distance between the visible surface and that of its pieces, m.

    Both ways: surface that no piece reaches, and pieces that fill what is empty. Faces
    between pieces, inside the solid, do not count.

    Args:
        pieces: convex meshes, m.
        mesh: the surface that they cover, m.
    """
    points, _ = trimesh.sample.sample_surface(mesh, 2000, seed=0)[:2]
    gap = np.min([_signed_distance(piece, points) for piece in pieces], axis=0)
    start = np.concatenate(
        [trimesh.sample.sample_surface(piece, 1000, seed=0)[0] for piece in pieces]
    )
    excess = signed_distances(mesh, start)
    return float(max(np.max(excess), np.max(gap), 0.0))


def _signed_distance(piece: trimesh.Trimesh, points: Array) -> Array:
    """Largest signed distance (N,) of points from the planes of a convex piece, m."""
    equations = ConvexHull(piece.vertices).equations
    return np.asarray((points @ equations[:, :3].T + equations[:, 3]).max(axis=1))


def simplify_hull(hull: trimesh.Trimesh, max_faces: int) -> trimesh.Trimesh:
    """Thins the vertices of a convex mesh while it stays within `HULL_TOLERANCE`.

    Vertices are taken greedily, the one farthest outside the hull of those taken
    before first, so that thin and pointed shapes keep their outline.

    Args:
        hull: convex mesh, m.
        max_faces: wanted number of faces; more are kept if the tolerance asks.
    """
    points = np.asarray(hull.vertices)
    if len(hull.faces) <= max_faces:
        return hull
    chosen = _extreme_points(points)
    while True:
        partial = ConvexHull(points[chosen])
        outside = (points @ partial.equations[:, :3].T + partial.equations[:, 3]).max(
            axis=1
        )
        full = len(partial.simplices) >= max_faces - 1
        if outside.max() < (HULL_TOLERANCE if full else 1e-5):
            return trimesh.Trimesh(points[chosen]).convex_hull
        chosen.append(int(outside.argmax()))


def _extreme_points(points: Array) -> list[int]:
    """Indices of vertices that span a volume: extremes along 13 directions."""
    grid = np.array(np.meshgrid(*[[-1, 0, 1]] * 3)).reshape(3, -1).T
    centred = points - points.mean(axis=0)
    return sorted({int(i) for i in (centred @ grid.T).argmax(axis=0)})


def _decompose(mesh: trimesh.Trimesh) -> list[Array]:
    """Vertices of each convex part, (N, 3), m."""
    # Loaded before pydrake, CoACD's bundled C++ runtime breaks pydrake's casts.
    import pydrake.systems.framework  # noqa: F401, I001

    import coacd

    coacd.set_log_level("off")
    fine = len(mesh.faces) > _FINE_FACES
    # A search half as long as the default finds about the same pieces of our objects.
    # The cuts of a fine mesh cost in proportion to its faces.
    parts = coacd.run_coacd(
        coacd.Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces)),
        threshold=_COACD_THRESHOLD,
        preprocess_mode="on" if fine else "auto",
        preprocess_resolution=20 if fine else 30,
        resolution=1000,
        mcts_nodes=10 if fine else 20,
        mcts_iterations=20 if fine else 60,
        seed=0,
    )
    return [np.asarray(vertices, dtype=np.float64) for vertices, _ in parts]


def _cache_folder() -> Path:
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "physim-drake" / "convex"


def _load_cached(key: str) -> list[Array] | None:
    try:
        with np.load(_cache_folder() / f"{key}.npz", allow_pickle=False) as data:
            return [data[name] for name in data.files]
    except (OSError, ValueError, RuntimeError, EOFError, BadZipFile):
        return None  # absent or damaged: compute it again


def _store_cached(key: str, clouds: list[Array]) -> None:
    """Keeps them for other runs; other processes may read meanwhile."""
    try:
        folder = _cache_folder()
        folder.mkdir(parents=True, exist_ok=True)
        with write_atomically(folder / f"{key}.npz", "wb") as file:
            np.savez_compressed(file, *clouds)
    except (OSError, InputError, RuntimeError):
        return  # a cache that cannot be written only costs time
