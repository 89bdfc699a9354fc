# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from physim_drake.objects.closed_surface import close_holes, find_boundary
from physim_drake.objects.model import DEFAULT_DENSITY, ObjectLibrary
from physim_drake.registration.distance_field import build_distance_field

RADIUS = 0.06
VOLUME = 2 / 3 * np.pi * RADIUS**3


@pytest.fixture
def bowl() -> trimesh.Trimesh:
    """A half ball without its flat side, away from the origin."""
    ball = trimesh.creation.icosphere(4, RADIUS)
    ball.update_faces(ball.triangles_center[:, 2] < 0)
    ball.remove_unreferenced_vertices()
    return ball.apply_translation([0, 0, 0.5])


def test_a_hole_is_closed_flat(bowl: trimesh.Trimesh) -> None:
    closed = close_holes(bowl)
    assert closed.is_watertight
    assert closed.volume == pytest.approx(VOLUME, rel=0.03)
    boundary = find_boundary(bowl)
    assert boundary.area == pytest.approx([np.pi * RADIUS**2], rel=0.03)
    assert boundary.is_open(bowl.area)


def test_each_hole_is_closed_by_itself() -> None:
    tube = trimesh.creation.cylinder(0.03, 0.1)
    tube.update_faces(np.abs(tube.face_normals[:, 2]) < 0.5)
    tube.remove_unreferenced_vertices()
    assert len(find_boundary(tube).area) == 2
    closed = close_holes(tube)
    assert closed.is_watertight
    assert closed.volume == pytest.approx(np.pi * 0.03**2 * 0.1, rel=0.02)


@pytest.mark.parametrize("turned", [False, True])
def test_an_open_mesh_is_used_as_it_is_and_has_the_volume_of_a_closed_one(
    bowl: trimesh.Trimesh, tmp_path: Path, turned: bool
) -> None:
    if turned:
        bowl.invert()
    bowl.export(tmp_path / "bowl.ply")
    model = ObjectLibrary.load(tmp_path)[1]
    assert len(model.mesh.faces) == len(bowl.faces)
    assert model.solid.volume == pytest.approx(VOLUME, rel=0.03)
    assert model.mass == pytest.approx(VOLUME * DEFAULT_DENSITY, rel=0.03)
    outward = model.mesh.face_normals @ [0, 0, -1]
    assert outward.mean() > 0.4
    assert any("it is open: " in text for text in model.problems)


def test_distances_are_to_the_open_mesh_and_signs_from_its_closed_copy(
    bowl: trimesh.Trimesh,
) -> None:
    field = build_distance_field(bowl, close_holes(bowl))
    inside, outside = [[0, 0, 0.48]], [[0, 0, 0.4]]
    assert field.query(np.array(inside))[0][0] == pytest.approx(-0.04, abs=0.003)
    assert field.query(np.array(outside))[0][0] == pytest.approx(0.04, abs=0.003)


def test_the_official_cup_loads(shared: Path) -> None:
    model = ObjectLibrary.load(shared / "data" / "real-cups" / "models")[2]
    assert model.solid.is_watertight
    assert len(model.solid.faces) > len(model.mesh.faces)
    assert model.solid.volume * 1e6 == pytest.approx(474, abs=1)
