# SPDX-License-Identifier: MIT
"""What a vacuum cup touches with, and what it feels of the objects it touches."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryId,
    HalfSpace,
    Mesh,
    ProximityProperties,
    SceneGraphInspector,
    Sphere,
    VolumeMesh,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import RigidBody
from scipy.spatial import ConvexHull

from physim_drake.errors import InputError
from physim_drake.objects.drake_shapes import obj_in_memory
from physim_drake.poses import Array, transform_points
from physim_drake.suction.cup import SuctionConfig, Surface

_SECTIONS = 96  # of round shapes: normals to 2 degrees, radii to a thousandth
_BALL_SUBDIVISIONS = 3
_CUP_LENGTH = 0.02  # m, of the geometry that touches
_CUP_SIDES = 12


def read_surface(
    inspector: SceneGraphInspector, geometries: Sequence[GeometryId], name: str
) -> Surface:
    """Reads a body's collision geometry.

    Args:
        inspector: inspector of the scene graph that the geometry is registered with.
        geometries: those of one body.
        name: the body's, for messages.

    Returns:
        the surface in the body's frame, curved shapes as polytopes.

    Raises:
        InputError: if there is no geometry, or a mesh that need not be convex.
    """
    if not geometries:
        raise InputError(name, "has no collision geometry", "give it some")
    pieces: list[Array] = []
    radius = 0.0
    for geometry in geometries:
        X_BS = inspector.GetPoseInFrame(geometry).GetAsMatrix4()
        shape = inspector.GetShape(geometry)
        if isinstance(shape, HalfSpace):
            normal = X_BS[:3, 2]
            pieces.append(np.append(normal, normal @ X_BS[:3, 3])[None])
            radius = np.inf
            continue
        vertices = transform_points(X_BS, _vertices(inspector, geometry, shape, name))
        radius = max(radius, float(np.linalg.norm(vertices, axis=1).max()))
        equations = ConvexHull(vertices).equations  # a flat face's triangles repeat
        planes = np.unique(np.round(equations, 9), axis=0)
        pieces.append(planes * [1, 1, 1, -1])
    return Surface.from_planes(pieces, radius)


def _vertices(
    inspector: SceneGraphInspector, geometry: GeometryId, shape: Any, name: str
) -> Array:
    """Vertices of a convex shape, (N, 3), m, in the shape's frame."""
    if isinstance(shape, Mesh):
        _require_hull(inspector, geometry, shape, name)
    if isinstance(shape, Mesh | Convex):
        hull = inspector.GetConvexHull(geometry)
        return np.array([hull.vertex(n) for n in range(hull.num_vertices())])
    solid: trimesh.Trimesh
    if isinstance(shape, Box):
        solid = trimesh.creation.box(shape.size())
    elif isinstance(shape, Cylinder):
        solid = trimesh.creation.cylinder(
            shape.radius(), shape.length(), sections=_SECTIONS
        )
    elif isinstance(shape, Capsule):
        ball = trimesh.creation.icosphere(_BALL_SUBDIVISIONS, shape.radius()).vertices
        end = np.array([0.0, 0.0, shape.length() / 2])
        return np.concatenate([ball + end, ball - end])
    elif isinstance(shape, Sphere):
        solid = trimesh.creation.icosphere(_BALL_SUBDIVISIONS, shape.radius())
    else:
        assert isinstance(shape, Ellipsoid)  # no other shape can be touched
        ball = trimesh.creation.icosphere(_BALL_SUBDIVISIONS).vertices
        return np.asarray(ball * [shape.a(), shape.b(), shape.c()])
    return np.asarray(solid.vertices)


def _require_hull(
    inspector: SceneGraphInspector, geometry: GeometryId, shape: Mesh, name: str
) -> None:
    """A soft surface mesh acts as its hull in contact. Any other need not be convex."""
    soft = isinstance(inspector.maybe_get_hydroelastic_mesh(geometry), VolumeMesh)
    if not soft or shape.extension() == ".vtk":
        raise InputError(
            name,
            f"collision mesh {inspector.GetName(geometry)} need not be convex",
            "give convex pieces, each declared convex",
        )


def require_hydroelastic(
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    body: RigidBody,
    soft: bool,
) -> None:
    """Refuses a body that would not touch hydroelastically.

    Args:
        plant: that the body is of.
        inspector: inspector of the scene graph.
        body: the body.
        soft: whether some of its geometry must be compliant; if not, all of it must be
            compliant or rigid.

    Raises:
        InputError: if it is not.
    """
    kinds = []
    for geometry in plant.GetCollisionGeometriesForBody(body):
        mesh = inspector.maybe_get_hydroelastic_mesh(geometry)
        flat = isinstance(inspector.GetShape(geometry), HalfSpace)
        kinds.append(isinstance(mesh, VolumeMesh) if soft else flat or mesh is not None)
    if not (any(kinds) if soft else all(kinds)):
        wanted = "compliant hydroelastic" if soft else "hydroelastic"
        raise InputError(
            body.name(),
            f"its collision geometry is not {wanted}",
            "set its proximity properties",
        )


def add_cup_geometry(
    plant: MultibodyPlant, body: RigidBody, X_BG: RigidTransform, config: SuctionConfig
) -> None:
    """Registers what a cup touches with: a soft bellows, and the block it ends on.

    Convex prisms have far fewer elements than Drake's cylinders, and a pressure
    that grows linearly with depth.

    Args:
        plant: not yet finalized.
        body: the cup's.
        X_BG: the lip's frame in it.
        config: the cup's.
    """
    for name, depth, stiffness in (
        ("bellows", 0.0, config.stiffness),
        ("stop", config.stroke, config.stop_stiffness),
    ):
        properties = ProximityProperties()
        AddContactMaterial(
            dissipation=config.dissipation,
            friction=CoulombFriction(config.friction, config.friction),
            properties=properties,
        )
        properties.AddProperty("material", "relaxation_time", config.relaxation_time)
        # Pressure is the modulus times depth over half the length.
        area = math.pi * config.lip_radius**2
        modulus = stiffness * _CUP_LENGTH / 2 / area
        AddCompliantHydroelasticProperties(config.lip_radius, modulus, properties)
        X_GS = RigidTransform([0.0, 0.0, -depth - _CUP_LENGTH / 2])
        plant.RegisterCollisionGeometry(
            body, X_BG @ X_GS, _prism(config.lip_radius), name, properties
        )


def cup_obj(radius: float) -> str:
    """An OBJ file's text: a prism with the area of a circle, its middle the origin.

    Args:
        radius: the circle's, m.
    """
    turn = 2 * math.pi / _CUP_SIDES
    corner = radius * math.sqrt(turn / math.sin(turn))
    lines = [
        f"v {corner * math.cos(n * turn):.9g} {corner * math.sin(n * turn):.9g} {z:.9g}"
        for z in (-_CUP_LENGTH / 2, _CUP_LENGTH / 2)
        for n in range(_CUP_SIDES)
    ]
    faces = [
        range(_CUP_SIDES, 0, -1),
        range(_CUP_SIDES + 1, 2 * _CUP_SIDES + 1),
        *(
            (n + 1, m + 1, m + 1 + _CUP_SIDES, n + 1 + _CUP_SIDES)
            for n, m in zip(range(_CUP_SIDES), [*range(1, _CUP_SIDES), 0], strict=True)
        ),
    ]
    lines += ["f " + " ".join(map(str, face)) for face in faces]
    return "\n".join(lines) + "\n"


def _prism(radius: float) -> Convex:
    return Convex(obj_in_memory(cup_obj(radius), "cup"))
