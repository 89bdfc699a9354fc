# SPDX-License-Identifier: MIT
from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from physim_drake.objects.model import ObjectLibrary
from physim_drake.objects.symmetry import (
    describe_symmetry,
    detect_symmetry,
    near_symmetries,
)
from physim_drake.poses import make_pose, rotation_angle

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"


def hull(points: object) -> trimesh.Trimesh:
    return trimesh.Trimesh(np.array(points, dtype=float)).convex_hull


def prism(sides: int, radius: float, height: float) -> trimesh.Trimesh:
    angles = 2 * np.pi * np.arange(sides) / sides
    ring = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return hull([[x, y, z] for x, y in ring for z in (-height / 2, height / 2)])


def l_shape() -> trimesh.Trimesh:
    return trimesh.util.concatenate(
        [
            trimesh.creation.box(bounds=[[0, 0, 0], [0.10, 0.03, 0.04]]),
            trimesh.creation.box(bounds=[[0, 0.03, 0], [0.03, 0.07, 0.06]]),
        ]
    )


def mug() -> trimesh.Trimesh:
    """Its handle is less than 5 % of the surface."""
    cup = trimesh.creation.annulus(0.035, 0.04, 0.1, sections=64)
    grip = trimesh.creation.cylinder(0.005, 0.06, sections=16)
    return trimesh.util.concatenate([cup, grip.apply_translation([0.065, 0, 0])])


@cache
def shapes() -> dict[str, tuple[trimesh.Trimesh, str]]:
    create = trimesh.creation
    tetrahedron = [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]
    return {
        "box": (create.box((0.06, 0.1, 0.15)), "4 discrete"),
        "nearly square": (create.box((0.062, 0.12, 0.064)), "8 discrete"),
        "cube": (create.box((0.1, 0.1, 0.1)), "24 discrete"),
        "triangle": (prism(3, 0.05, 0.1), "6 discrete"),
        "hexagon": (prism(6, 0.05, 0.13), "12 discrete"),
        "octagon": (prism(8, 0.06, 0.05), "16 discrete"),
        "tetrahedron": (hull(0.05 * np.array(tetrahedron)), "12 discrete"),
        "wedge": (hull(prism(3, 0.05, 0.1).vertices * [1, 1.5, 1]), "2 discrete"),
        "L": (l_shape(), "none"),
        "cylinder": (create.cylinder(0.04, 0.12, sections=64), "round + flip"),
        "flat cylinder": (create.cylinder(0.06, 0.06, sections=64), "round + flip"),
        "mug": (mug(), "2 discrete"),  # the half turn about its handle
        "ring": (create.annulus(0.03, 0.05, 0.04, sections=64), "round + flip"),
        "cone": (create.cone(0.05, 0.12, sections=64), "round"),
        "ball": (create.icosphere(4, 0.05), "ball"),
    }


def detected(mesh: trimesh.Trimesh) -> str:
    group = detect_symmetry(mesh)
    if group.axes and not group.is_ball:
        return "round + flip" if len(group.discrete) == 2 else "round"
    return describe_symmetry(group)


@pytest.mark.parametrize("name", shapes())
def test_known_shapes(name: str) -> None:
    mesh, expected = shapes()[name]
    assert detected(mesh) == expected


QUICK = [name for name in shapes() if name not in ("cube", "tetrahedron", "hexagon")]


@settings(max_examples=15, deadline=None)
@given(st.sampled_from(QUICK), st.integers(0, 2**31))
def test_a_rigid_motion_does_not_change_the_group(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    mesh, expected = shapes()[name]
    X = make_pose(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3))
    moved = mesh.copy()
    moved.apply_transform(X)
    assert detected(moved) == expected


@pytest.mark.parametrize("name", ["nearly square", "cube", "triangle", "cylinder"])
def test_discrete_motions_form_a_group(name: str) -> None:
    group = detect_symmetry(shapes()[name][0]).discrete
    np.testing.assert_allclose(group[0], np.eye(4), atol=1e-12)
    products = (group[:, None] @ group[None]).reshape(-1, 4, 4)
    apart = np.abs(products[:, None] - group[None]).max(axis=(2, 3)).min(axis=1)
    assert apart.max() < 1e-9


def test_symmetries_map_the_shape_onto_itself() -> None:
    mesh = shapes()["octagon"][0].copy()
    mesh.apply_translation([0.3, 0.2, 0.1])
    for X in detect_symmetry(mesh).discrete:
        moved = trimesh.transform_points(mesh.vertices, X)
        gaps = np.linalg.norm(moved[:, None] - mesh.vertices[None], axis=2).min(axis=1)
        assert gaps.max() < 5e-4


def test_continuous_axis_runs_through_the_shape() -> None:
    mesh = trimesh.creation.cone(0.05, 0.12, sections=64)
    mesh.apply_translation([0.3, -0.2, 0.0])
    axis = detect_symmetry(mesh).axes[0]
    np.testing.assert_allclose(axis.axis, [0, 0, 1], atol=1e-3)
    np.testing.assert_allclose(axis.point[:2], [0.3, -0.2], atol=1e-4)


def test_tolerance_decides_what_is_equal() -> None:
    mesh = trimesh.creation.box((0.06, 0.07, 0.12))
    assert len(detect_symmetry(mesh).discrete) == 4
    assert len(detect_symmetry(mesh, tolerance=0.006).discrete) == 8


def test_near_symmetries_are_the_flips_left() -> None:
    mesh = trimesh.creation.box((0.06, 0.07, 0.12))
    group = detect_symmetry(mesh)
    near = near_symmetries(mesh, 0.015, group)
    assert len(near) == 1  # the quarter turn; others differ by a half turn
    assert rotation_angle(near[0, :3, :3]) == pytest.approx(np.pi / 2)
    assert near_symmetries(mesh, 0.002, group).shape == (0, 4, 4)
    flip = near_symmetries(trimesh.creation.cone(0.03, 0.03, sections=64), 0.02)
    assert len(flip) >= 1
    assert near_symmetries(trimesh.creation.icosphere(3, 0.05), 0.02).size == 0


def test_words() -> None:
    mesh = trimesh.creation.cylinder(0.04, 0.12, sections=64)
    assert describe_symmetry(detect_symmetry(mesh)) == "continuous about z + flip"
    mesh.apply_transform(make_pose(Rotation.from_rotvec([0.5, 0, 0]).as_matrix()))
    words = describe_symmetry(detect_symmetry(mesh))
    assert words.startswith("continuous about (")


def test_the_eleven_objects_get_the_groups_stated_for_them() -> None:
    folder = SHARED / "apc11-dev" / "models"
    if not folder.is_dir():
        pytest.skip("the eleven objects are not there")
    for model in ObjectLibrary.load(folder).values():
        found = detect_symmetry(model.mesh)
        assert describe_symmetry(found) == describe_symmetry(model.symmetry), model.name
        if not found.is_ball:
            for X in model.symmetry.discrete:
                near = found.rotation_distance(X[:3, :3], np.eye(3))
                assert near < np.radians(1), model.name
