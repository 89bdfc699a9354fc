# SPDX-License-Identifier: MIT
from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from physim_drake.errors import InputError
from physim_drake.poses import Array, make_pose
from physim_drake.suction.cup import (
    NO_SEAL,
    Seal,
    SuctionConfig,
    Surface,
    cast_lines,
    find_seal,
    step_vacuum,
)

CUP = SuctionConfig()
DOWN = Rotation.from_euler("x", 180, degrees=True).as_matrix()


def surface(*solids: trimesh.Trimesh) -> Surface:
    pieces = [ConvexHull(s.vertices).equations * [1, 1, 1, -1] for s in solids]
    radius = max(float(np.linalg.norm(s.vertices, axis=1).max()) for s in solids)
    return Surface.from_planes(pieces, radius)


def box(
    size: tuple[float, float, float] = (0.1, 0.1, 0.1),
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> trimesh.Trimesh:
    return trimesh.creation.box(size, make_pose(p=centre))


def lying_cylinder(radius: float) -> Surface:
    lying = trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0])
    return surface(
        trimesh.creation.cylinder(radius, 0.2, sections=200, transform=lying)
    )


def ball(radius: float) -> Surface:
    return surface(trimesh.creation.icosphere(4, radius))


def above(
    gap: float, height: float = 0.05, x: float = 0.0, tilt_deg: float = 0.0
) -> Array:
    """A cup that looks down from `gap` above z = `height`, tilted about y."""
    R = Rotation.from_euler("y", tilt_deg, degrees=True).as_matrix()
    return make_pose(R @ DOWN, [x, 0, height + gap])


def seal(X_WG: Array, *surfaces: Surface, config: SuctionConfig = CUP) -> Seal:
    return find_seal(X_WG, [np.eye(4)] * len(surfaces), surfaces, config)


def test_lines_meet_the_first_piece_ahead() -> None:
    solid = surface(box((0.1, 0.1, 0.02)), box((0.02, 0.02, 0.1)))
    points = np.array([[0.0, 0, 0.2], [0.03, 0, 0.2], [0.2, 0, 0.2], [0, 0, 0.04]])
    gaps, normals = cast_lines(solid, points, np.array([0.0, 0, -1]), -0.02)
    np.testing.assert_allclose(gaps, [0.15, 0.19, np.inf, -0.01])
    np.testing.assert_allclose(normals[[0, 1, 3]], [[0, 0, 1]] * 3, atol=1e-12)


def test_lines_do_not_meet_what_is_behind() -> None:
    gaps, _ = cast_lines(
        surface(box()), np.array([[0, 0, -0.08]]), np.array([0.0, 0, -1]), -0.02
    )
    assert np.isinf(gaps[0])


@pytest.mark.parametrize("gap", [-0.004, 0.0, 0.0009])
def test_a_flat_face_within_reach_is_tight(gap: float) -> None:
    found = seal(above(gap), surface(box()))
    assert found.index == 0
    assert found.leak == 0.0
    assert found.gap == pytest.approx(gap)
    np.testing.assert_allclose(found.normal, [0, 0, 1], atol=1e-12)


@pytest.mark.parametrize("gap", [0.0011, 0.05, 1.0, -0.011])
def test_a_face_out_of_reach_is_not_touched(gap: float) -> None:
    assert seal(above(gap), surface(box())).index is None
    assert seal(above(gap)) is NO_SEAL


@pytest.mark.parametrize(
    ("overhang", "share"), [(-0.016, 0.0), (0.0, 0.5), (0.0075, 2 / 3), (0.0151, 1.0)]
)
def test_what_hangs_over_an_edge_leaks(overhang: float, share: float) -> None:
    found = seal(above(0.0, x=0.05 + overhang), surface(box()))
    assert found.leak == pytest.approx(share, abs=1 / CUP.lip_points + 1e-9)


@pytest.mark.parametrize(
    ("tilt", "tight"),
    [(5, True), (8, True), (16, False), (25, False)],
)
def test_the_lip_follows_a_tilt_up_to_its_limit(tilt: float, tight: bool) -> None:
    down = CUP.lip_radius * math.sin(math.radians(tilt))
    pressed = 0.9 * CUP.lip_reach - down
    found = seal(above(pressed, tilt_deg=tilt), surface(box()))
    assert found.leak == (0.0 if tight else 1.0)
    np.testing.assert_allclose(found.normal, [0, 0, 1], atol=1e-9)


def test_a_tilted_cup_that_is_not_pressed_leaks() -> None:
    assert seal(above(0.0, tilt_deg=8), surface(box())).leak > 0.25


@pytest.mark.parametrize(
    ("radius", "tight"),
    [(0.05, True), (0.035, True), (0.02, False)],
)
def test_the_lip_bends_round_a_large_cylinder_only(radius: float, tight: bool) -> None:
    bulge = radius - math.sqrt(radius**2 - CUP.lip_radius**2)
    found = seal(above(0.9 * CUP.lip_reach - bulge, radius), lying_cylinder(radius))
    assert (found.leak == 0.0) == tight
    np.testing.assert_allclose(found.normal, [0, 0, 1], atol=1e-3)


@pytest.mark.parametrize(
    ("radius", "pressed", "tight"),
    [(0.0365, 0.003, True), (0.02, 0.0055, False), (0.012, 0.0055, False)],
)
def test_a_small_ball_does_not_reach_the_lip(
    radius: float, pressed: float, tight: bool
) -> None:
    assert seal(above(-pressed, radius), ball(radius)).leak == (0.0 if tight else 1.0)


def test_a_step_under_the_lip_leaks_and_a_joint_of_one_object_does_not() -> None:
    left, right = box(centre=(-0.05, 0, 0)), box(centre=(0.05, 0, 0))
    lower = box(centre=(0.05, 0, -0.004))
    assert seal(above(0.0), surface(left, right)).leak == 0.0
    assert seal(above(0.0), surface(left, lower)).leak == pytest.approx(0.5, abs=0.05)


def test_two_objects_side_by_side_leak_between_them() -> None:
    left, right = box(centre=(-0.045, 0, 0)), box(centre=(0.055, 0, 0))
    found = seal(above(0.0), surface(right), surface(left))
    assert found.index == 1
    assert 0.2 < found.leak < 0.5


def test_the_foremost_object_counts() -> None:
    found = seal(above(0.0), surface(box()), surface(box((0.1, 0.1, 0.098))))
    assert (found.index, found.leak) == (0, 0.0)


@given(
    st.lists(st.floats(-3, 3), min_size=6, max_size=6),
    st.floats(-0.004, 0.0005),
    st.floats(-10, 10),
)
def test_where_the_world_is_does_not_matter(
    world: list[float], gap: float, tilt: float
) -> None:
    X = make_pose(Rotation.from_rotvec(world[:3]).as_matrix(), world[3:])
    solid = surface(box(), box((0.02, 0.02, 0.107), (0.03, 0.0, 0.0)))
    X_WG = above(gap, x=0.01, tilt_deg=tilt)
    here = seal(X_WG, solid)
    there = find_seal(X @ X_WG, [X], [solid], CUP)
    assert there.index == here.index
    assert there.leak == pytest.approx(here.leak, abs=1.01 / CUP.lip_points)
    if there.leak == here.leak:
        np.testing.assert_allclose(there.normal, here.normal, atol=1e-6)
        assert there.gap == pytest.approx(here.gap, abs=1e-8)


def levels(time: float, leak: float, start: float, on: bool, step: float) -> float:
    level = start
    for _ in range(round(time / step)):
        level = step_vacuum(level, leak, on, step, CUP)
    return level


def test_a_tight_cup_is_evacuated_with_its_time_constant() -> None:
    level = levels(CUP.build_up_time, 0.0, 0.0, True, 1e-5)
    assert level == pytest.approx(1 - math.exp(-1), abs=1e-3)
    assert levels(0.3, 0.0, 0.0, True, 0.005) > 0.99


def test_a_closed_valve_vents_with_its_time_constant() -> None:
    level = levels(CUP.vent_time, 0.0, 1.0, False, 1e-5)
    assert level == pytest.approx(math.exp(-1), abs=1e-3)


@pytest.mark.parametrize("leak", [1 / 24, 1 / 8, 0.5, 1.0])
def test_a_leak_settles_where_pump_and_orifice_balance(leak: float) -> None:
    level = levels(1.0, leak, 0.0, True, 0.005)
    assert 1 - level == pytest.approx(CUP.leak_ratio * leak * math.sqrt(level))
    assert levels(1.0, leak, 1.0, True, 0.005) == pytest.approx(level)


def test_half_a_lip_holds_nothing_and_air_rushes_in() -> None:
    assert levels(1.0, 0.5, 0.0, True, 0.005) < 0.02
    assert levels(0.015, 1.0, 1.0, True, 0.001) < 0.05


@given(st.floats(0, 1), st.floats(0, 1), st.booleans(), st.floats(1e-5, 10))
def test_no_step_leaves_the_range(
    level: float, leak: float, on: bool, step: float
) -> None:
    assert 0 <= step_vacuum(level, leak, on, step, CUP) <= 1


def test_the_full_vacuum_pulls_with_pressure_times_area() -> None:
    assert CUP.max_force == pytest.approx(50e3 * math.pi * 0.015**2)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("lip_radius", 0.0),
        ("vacuum_pressure", -1.0),
        ("lip_reach", -1e-3),
        ("max_tilt", 15.0),
        ("lip_points", 4),
        ("holding_level", 1.0),
        ("period", math.nan),
    ],
)
def test_a_wrong_setting_is_named(field: str, value: Any) -> None:
    with pytest.raises(InputError, match=f"SuctionConfig: {field}: is .*must"):
        replace(CUP, **{field: value})
