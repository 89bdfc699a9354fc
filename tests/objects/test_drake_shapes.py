# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
from pydrake.geometry import Convex, Mesh

from physim_drake.objects.drake_shapes import collision_shapes, mesh_shape
from physim_drake.poses import Array
from tests.synthetic import SOAP, TAPE, library


def vertices(shape: Convex | Mesh) -> Array:
    hull = shape.GetConvexHull()
    return np.array([hull.vertex(n) for n in range(hull.num_vertices())])


def test_collision_shapes_are_the_convex_pieces() -> None:
    model = library()[TAPE]
    shapes = collision_shapes(model)
    assert len(shapes) == len(model.collision_pieces) > 1
    for shape, piece in zip(shapes, model.collision_pieces, strict=True):
        highest = vertices(shape).max(axis=0)
        np.testing.assert_allclose(highest, piece.bounds[1], atol=1e-6)


def test_a_mesh_keeps_its_size() -> None:
    mesh = library()[SOAP].mesh
    corners = vertices(mesh_shape(mesh, "soap"))
    np.testing.assert_allclose(
        [corners.min(axis=0), corners.max(axis=0)], mesh.bounds, atol=1e-6
    )
