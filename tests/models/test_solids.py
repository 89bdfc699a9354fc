# SPDX-License-Identifier: MIT
import numpy as np
import pytest
import trimesh

from physim_drake.models.solids import lofted, mtl_text, obj_text, oval, rounded, turned


def as_mesh(patch) -> trimesh.Trimesh:
    a, b, c, d = patch.quads.T
    faces = np.concatenate([np.stack([a, c, d], -1), np.stack([a, b, c], -1)])
    return trimesh.Trimesh(patch.vertices, faces[faces[:, 0] != faces[:, 1]])


def test_corner_is_rounded_by_the_given_radius():
    line = rounded([(0, 0), (1, 0), (1, 1)], 0.2, steps=8)
    np.testing.assert_allclose(
        line[[0, 1, -2, -1]], [(0, 0), (0.8, 0), (1, 0.2), (1, 1)]
    )
    distance = np.linalg.norm(line[1:-1] - (0.8, 0.2), axis=1)
    np.testing.assert_allclose(distance, 0.2)


def test_corner_without_radius_is_kept_twice_and_a_straight_one_once():
    sharp = rounded([(0, 0), (1, 0), (1, 1)], 0.0)
    np.testing.assert_allclose(sharp, [(0, 0), (1, 0), (1, 0), (1, 1)])
    straight = rounded([(0, 0), (1, 0), (2, 0)], 0.3)
    np.testing.assert_allclose(straight, [(0, 0), (1, 0), (2, 0)])


def test_turned_cylinder_is_closed_and_faces_outward():
    mesh = as_mesh(turned([(0, 0), (1, 0), (1, 2), (0, 2)], "steel", 64))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(2 * np.pi, rel=0.01)


def test_loft_through_squares_is_a_frustum():
    rings = [oval((0, 0, z), (1 - z / 2, 1 - z / 2), 200.0, 8) for z in (0.0, 1.0)]
    mesh = as_mesh(lofted(rings, "steel", ((0, 0, 0), (0, 0, 1))))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx((4 + 2 + 1) / 3, rel=0.01)


def test_normals_are_smooth_over_a_round_and_break_at_a_ring_given_twice():
    can = turned(rounded([(0, 0), (1, 0), (1, 2), (0, 2)], 0.0), "steel", 64)
    normals = can.normals()
    sideways = np.abs(normals[:, 2]) < 1e-9
    upright = np.abs(np.abs(normals[:, 2]) - 1) < 1e-9
    assert np.all(sideways | upright)
    around = can.vertices[sideways][:, :2]
    np.testing.assert_allclose(normals[sideways][:, :2], around, atol=1e-9)


def test_moved_patch_turns_and_shifts():
    R = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    patch = turned([(1, 0), (1, 1)], "steel", 4).moved(R, (0, 0, 5))
    np.testing.assert_allclose(patch.vertices[0], (0, 1, 5), atol=1e-12)


def test_files_hold_what_they_should(tmp_path):
    parts = [
        turned([(0, 0), (1, 0), (1, 2), (0, 2)], "steel", 16),
        turned([(0, 0), (1, 0), (1, 1), (0, 1)], "brass", 16).moved(p=(5, 0, 0)),
    ]
    (tmp_path / "a.obj").write_text(obj_text(parts, "a.mtl"))
    (tmp_path / "a.mtl").write_text(mtl_text({"steel": (0, 0, 1), "brass": (1, 1, 0)}))
    mesh = trimesh.load(tmp_path / "a.obj", force="mesh")
    np.testing.assert_allclose(mesh.bounds, [(-1, -1, 0), (6, 1, 2)])
    assert mesh.volume == pytest.approx(3 * np.pi, rel=0.03)
    text = (tmp_path / "a.obj").read_text()
    assert text.count("usemtl") == 2
