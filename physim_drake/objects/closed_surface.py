# SPDX-License-Identifier: MIT
"""Open surfaces and their closed copies.

A bowl, a basket or a scan without a bottom has no inside. What needs one (signed
distances, volume, mass, collision) is made from a copy whose holes are closed. What is
drawn and matched is the surface as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from physim_drake.poses import Array

_MAX_BOUNDARY_EDGES = 0.05  # share of all edges
_MAX_HOLE_AREA = 0.05  # share of the surface
_SMALL_HOLE_AREA = 0.01  # share of the surface; below it, all edges may be boundaries


@dataclass(frozen=True)
class Boundary:
    """The edges of a surface that have one face only, by connected piece.

    Attributes:
        edges: (E, 2) vertices, in the direction of their face.
        piece: (E,) number of the piece that each belongs to.
        area: (P,) area of each piece's hole, m^2.
        shared: number of edges with more than two faces.
        share: of the edges with one face, among all edges.
    """

    edges: NDArray[np.int64]
    piece: NDArray[np.int64]
    area: Array
    shared: int
    share: float

    def is_open(self, surface_area: float) -> bool:
        """Whether the holes are so large that inside and outside are not distinct.

        Args:
            surface_area: area of the whole surface, m^2.
        """
        holes = float(self.area.sum()) / surface_area
        return holes > _MAX_HOLE_AREA or (
            self.share > _MAX_BOUNDARY_EDGES and holes > _SMALL_HOLE_AREA
        )


def find_boundary(mesh: trimesh.Trimesh) -> Boundary:
    """Finds the holes of a surface.

    The area of a hole is the vector area of its rim, which does not depend on how the
    hole would be filled and is zero for a crack whose sides lie together.

    Args:
        mesh: the surface, m.
    """
    uses = np.bincount(mesh.edges_unique_inverse)
    edges = np.asarray(mesh.edges)[uses[mesh.edges_unique_inverse] == 1]
    shared = int(np.count_nonzero(uses > 2))
    if len(edges) == 0:
        nothing = np.zeros(0, dtype=np.int64)
        return Boundary(edges, nothing, np.zeros(0), shared, 0.0)
    count = len(mesh.vertices)
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), (count, count))
    label = connected_components(graph, directed=False)[1][edges[:, 0]]
    _, first, piece = np.unique(label, return_index=True, return_inverse=True)
    start, end = (np.asarray(mesh.vertices)[edges[:, k]] for k in (0, 1))
    # Relative to one point of its own rim, so that a loop left open by an edge with
    # three faces counts as closed through that point.
    origin = start[first][piece]
    vectors = np.zeros((len(first), 3))
    np.add.at(vectors, piece, np.cross(start - origin, end - origin) / 2)
    area = np.linalg.norm(vectors, axis=1)
    return Boundary(edges, piece, area, shared, len(edges) / len(uses))


def close_holes(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Returns a copy in which a fan of faces closes each hole, from its middle.

    Args:
        mesh: the surface, m.
    """
    boundary = find_boundary(mesh)
    if len(boundary.edges) == 0:
        return mesh
    vertices = np.asarray(mesh.vertices)
    start, end = (vertices[boundary.edges[:, k]] for k in (0, 1))
    length = np.linalg.norm(end - start, axis=1)
    total = np.bincount(boundary.piece, length)
    middles = np.stack(
        [
            np.bincount(boundary.piece, length * (start + end)[:, k] / 2) / total
            for k in range(3)
        ],
        axis=1,
    )
    apex = len(vertices) + boundary.piece
    fans = np.stack([boundary.edges[:, 1], boundary.edges[:, 0], apex], axis=1)
    return trimesh.Trimesh(
        np.concatenate([vertices, middles]),
        np.concatenate([np.asarray(mesh.faces), fans]),
        process=False,
    )


def closed_copy(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Returns the surface itself, or a closed copy if it is open.

    Args:
        mesh: the surface, m.
    """
    is_open = find_boundary(mesh).is_open(float(mesh.area))
    return close_holes(mesh) if is_open else mesh


def describe_boundary(mesh: trimesh.Trimesh) -> list[str]:
    """Puts in words what is open and what was closed, a sentence each."""
    boundary = find_boundary(mesh)
    once, area = len(boundary.edges), float(mesh.area)
    problems = []
    if once and boundary.is_open(area):
        large = np.count_nonzero(boundary.area > 1e-3 * area)
        problems.append(
            f"it is open: {once} edges have one face only ({large} large holes, "
            f"{boundary.area.sum() / area:.0%} of area). A closed copy gives volume, "
            "mass, collision and the sides of the surface"
        )
    elif once:
        holes = boundary.area.sum() / area
        problems.append(f"{once} edges have one face only (holes {holes:.1%} of area)")
    if boundary.shared:
        problems.append(f"{boundary.shared} edges have more than two faces")
    return problems
