# SPDX-License-Identifier: MIT
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydrake.common import MemoryFile
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    InMemoryMesh,
    Mesh,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    MultibodyPlant,
)
from pydrake.multibody.tree import RigidBody, SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from physim_drake.errors import InputError
from physim_drake.suction.contact import (
    add_cup_geometry,
    read_surface,
    require_hydroelastic,
)
from physim_drake.suction.cup import SuctionConfig, Surface, cast_lines
from tests.systems.gantry import contact

TETRAHEDRON = (
    "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
)
X_BS = RigidTransform(RollPitchYaw(0.3, -0.5, 0.7), [0.02, -0.01, 0.03])


def mesh(kind: Any) -> Any:
    return kind(InMemoryMesh(mesh_file=MemoryFile(TETRAHEDRON, ".obj", "t.obj")))


def plant_with(
    *shapes: Any, modulus: float | None = 1e7, X: RigidTransform = X_BS
) -> tuple[DiagramBuilder, MultibodyPlant, SceneGraph, RigidBody]:
    """The builder keeps the others alive."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.01)
    body = plant.AddRigidBody("body", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    for n, shape in enumerate(shapes):
        plant.RegisterCollisionGeometry(body, X, shape, f"{n}", contact(modulus))
    plant.Finalize()
    return builder, plant, scene_graph, body


def read(*shapes: Any, modulus: float | None = 1e7) -> Surface:
    _builder, plant, scene_graph, body = plant_with(*shapes, modulus=modulus)
    return read_surface(
        scene_graph.model_inspector(),
        plant.GetCollisionGeometriesForBody(body),
        "body",
    )


@pytest.mark.parametrize(
    ("shape", "top"),
    [
        (Box(0.04, 0.06, 0.08), 0.04),
        (Cylinder(0.03, 0.08), 0.04),
        (Sphere(0.03), 0.03),
        (Capsule(0.02, 0.05), 0.045),
        (Ellipsoid(0.03, 0.02, 0.05), 0.05),
        (HalfSpace(), 0.0),
        (mesh(Convex), 0.1),
        (mesh(Mesh), 0.1),
    ],
)
def test_a_line_meets_a_shape_where_the_shape_is(shape: Any, top: float) -> None:
    surface = read(shape, modulus=None if isinstance(shape, HalfSpace) else 1e7)
    start = (X_BS @ np.array([1e-5, 1e-5, 0.2]))[None]
    along = -X_BS.rotation().matrix()[:, 2]
    gaps, _ = cast_lines(surface, start, along, -0.01)
    assert gaps[0] == pytest.approx(0.2 - top, abs=1e-4)
    assert surface.radius >= np.linalg.norm(X_BS @ np.array([0, 0, top])) - 1e-3


def test_a_flat_face_is_one_plane_and_pieces_stay_apart() -> None:
    surface = read(Box(0.04, 0.06, 0.08), mesh(Convex))
    np.testing.assert_array_equal(surface.ends, [6, 10])


@pytest.mark.parametrize(
    ("shapes", "message"),
    [((), "no collision geometry"), ((mesh(Mesh),), "need not be convex")],
)
def test_what_a_cup_cannot_feel_is_refused(
    shapes: tuple[Any, ...], message: str
) -> None:
    with pytest.raises(InputError, match=f"body: .*{message}"):
        read(*shapes, modulus=None)


def test_hydroelastic_contact_is_required() -> None:
    _builder, plant, scene_graph, body = plant_with(Box(1, 1, 1), modulus=None)
    inspector = scene_graph.model_inspector()
    require_hydroelastic(plant, inspector, body, soft=False)
    with pytest.raises(InputError, match=r"body: .* not compliant hydroelastic"):
        require_hydroelastic(plant, inspector, body, soft=True)


def test_the_cup_ends_at_its_lip_and_the_block_behind_the_stroke() -> None:
    config = SuctionConfig()
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.01)
    body = plant.AddRigidBody("cup", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    add_cup_geometry(plant, body, X_BS, config)
    plant.Finalize()
    inspector = scene_graph.model_inspector()
    geometries = plant.GetCollisionGeometriesForBody(body)
    start = (X_BS @ np.array([0.0, 0, 0.1]))[None]
    along = -X_BS.rotation().matrix()[:, 2]
    fronts = [
        cast_lines(read_surface(inspector, [g], "cup"), start, along, 0.0)[0][0] - 0.1
        for g in geometries
    ]
    np.testing.assert_allclose(sorted(fronts), [0.0, config.stroke], atol=1e-6)
    require_hydroelastic(plant, inspector, body, soft=True)
