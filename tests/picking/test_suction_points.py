# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from physim_drake.objects.model import ObjectModel
from physim_drake.picking.lip_rays import surface_heights
from physim_drake.picking.suction_points import SuctionCup, suction_points
from physim_drake.poses import SymmetryGroup
from tests.synthetic import BALL, ERASER, GLUE, TAPE, library

CUP = SuctionCup()


def model_of(mesh: trimesh.Trimesh, mass: float = 0.2) -> ObjectModel:
    return ObjectModel.from_mesh(1, "thing", mesh, symmetry=SymmetryGroup(), mass=mass)


def box(*size: float) -> ObjectModel:
    return model_of(trimesh.creation.box(size))


def test_rays_find_the_height_of_a_step() -> None:
    mesh = trimesh.util.concatenate(
        [
            trimesh.creation.box(bounds=[[-0.1, -0.1, -0.02], [0.1, 0.1, 0.0]]),
            trimesh.creation.box(bounds=[[0.0, -0.1, 0.0], [0.1, 0.1, 0.012]]),
        ]
    )
    center, up = np.array([[-0.005, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]])
    pattern = np.array([[0.01, 0.0], [-0.01, 0.0], [0.0, 0.01], [0.0, -0.01], [0.3, 0]])
    heights = surface_heights(mesh, center, up, pattern, 0.03)[0]
    # The axes of the cup's plane may point either way: one ray of four is on the step.
    assert sorted(np.round(heights[:4], 6)) == [0.0, 0.0, 0.0, 0.012]
    assert np.isnan(heights[4])


def test_a_cup_keeps_its_whole_lip_on_the_face_of_a_box() -> None:
    half = np.array([0.03, 0.05, 0.04])
    points = suction_points(box(*2 * half))
    assert len(points) > 20
    axis = np.abs(points.normals).argmax(axis=1)
    assert set(axis) == {0, 1, 2}
    for p, n, k in zip(points.positions, points.normals, axis, strict=True):
        np.testing.assert_allclose(np.abs(n), np.eye(3)[k], atol=1e-9)
        assert abs(p[k]) == pytest.approx(half[k], abs=1e-9)
        room = np.delete(half - np.abs(p), k)
        assert room.min() > CUP.lip_radius - 1e-9
    assert np.allclose(points.flatness, 1)
    assert np.allclose(points.dome, 0, atol=1e-9)


def test_quality_falls_away_from_the_middle_and_at_edges() -> None:
    points = suction_points(box(0.16, 0.16, 0.02))
    order = np.argsort(np.linalg.norm(points.positions[:, :2], axis=1))
    leverage = points.leverage[order]
    assert (np.diff(leverage) < 1e-9).all()
    assert leverage[0] > leverage[-1] + 0.1
    room = 0.08 - np.abs(points.positions[:, :2]).max(axis=1) - CUP.lip_radius
    assert (points.margin[room < 0.0015] < 0.5).all()
    assert (points.margin[room > CUP.margin] == 1).all()
    assert (np.diff(points.quality) <= 1e-9).all()


def test_a_heavy_object_is_held_near_its_middle_only() -> None:
    size = (0.2, 0.1, 0.03)
    light = suction_points(model_of(trimesh.creation.box(size), 0.1))
    heavy = suction_points(model_of(trimesh.creation.box(size), 1.0))
    reach = [np.abs(p.positions[:, 0]).max() for p in (light, heavy)]
    assert reach[1] < 0.6 * reach[0]
    # Beyond the vacuum's force nothing holds.
    assert len(suction_points(model_of(trimesh.creation.box(size), 5.0))) == 0


def test_a_box_narrower_than_the_lip_has_points_on_its_wide_faces_only() -> None:
    points = suction_points(box(0.08, 0.06, 0.025))
    assert len(points) > 0
    assert (np.abs(points.normals[:, 2]) > 0.999).all()
    assert len(suction_points(box(0.025, 0.06, 0.025))) == 0


def test_a_ball_seals_everywhere_though_it_bulges_into_the_cup() -> None:
    radius = 0.037
    ball = model_of(trimesh.creation.icosphere(5, radius))
    points = suction_points(ball)
    assert len(points) > 50
    dome = radius - np.sqrt(radius**2 - CUP.lip_radius**2)
    np.testing.assert_allclose(points.dome, dome, atol=3e-4)
    np.testing.assert_allclose(
        points.normals, points.positions / radius, atol=np.radians(2)
    )
    # A marble's dome does not fit into the cup.
    marble = model_of(trimesh.creation.icosphere(4, 0.018))
    assert len(suction_points(marble)) == 0


@pytest.mark.parametrize(("radius", "seals"), [(0.035, True), (0.025, False)])
def test_conformity_decides_how_thin_a_cylinder_may_be(
    radius: float, seals: bool
) -> None:
    # The lip's ring leaves its mean plane by r^2 / 4R: 1.6 mm and 2.3 mm.
    can = model_of(trimesh.creation.cylinder(radius, 0.15, sections=96))
    on_side = np.abs(suction_points(can).normals[:, 2]) < 0.1
    assert on_side.any() == seals
    soft = replace(CUP, conformity=0.003)
    assert (np.abs(suction_points(can, soft).normals[:, 2]) < 0.1).any()


def test_a_ring_is_held_outside_and_never_over_its_hole() -> None:
    ring = model_of(trimesh.creation.annulus(0.04, 0.05, 0.048, sections=96))
    points = suction_points(ring)
    assert len(points) > 0
    from_axis = np.linalg.norm(points.positions[:, :2], axis=1)
    np.testing.assert_allclose(from_axis, 0.05, atol=5e-4)


@pytest.mark.parametrize("object_id", [ERASER, TAPE, GLUE, BALL])
def test_points_of_real_objects_lie_on_their_surface_and_are_spread(
    object_id: int,
) -> None:
    model = library()[object_id]
    points = suction_points(model)
    assert len(points) >= 20
    assert (points.quality > 0).all()
    assert (points.quality <= 1).all()
    _, distances, faces = trimesh.proximity.closest_point(model.mesh, points.positions)
    assert distances.max() < 5e-4
    facing = (model.mesh.face_normals[faces] * points.normals).sum(axis=1)
    assert np.median(facing) > 0.95
    assert facing.min() > 0.8
    gaps = np.linalg.norm(points.positions[:, None] - points.positions, axis=2)
    same_side = points.normals @ points.normals.T > np.cos(np.radians(35))
    np.fill_diagonal(same_side, False)
    assert gaps[same_side].min() >= CUP.spacing


def test_points_are_found_once_a_model_and_cannot_be_changed() -> None:
    model = box(0.05, 0.06, 0.07)
    points = suction_points(model)
    assert suction_points(model) is points
    with pytest.raises(ValueError, match="read-only"):
        points.positions[0, 0] = 1.0
    again = suction_points(box(0.05, 0.06, 0.07))
    np.testing.assert_array_equal(again.positions, points.positions)
