# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from physim_drake.camera import CameraIntrinsics
from physim_drake.pose_errors import (
    add,
    add_s,
    mean_rpy,
    mspd,
    mssd,
    pose_error,
    symmetry_samples,
)
from physim_drake.poses import (
    Array,
    ContinuousAxis,
    SymmetryGroup,
    exp_pose,
    make_pose,
)

Z = np.array([0.0, 0.0, 1.0])
HALF_TURN = make_pose(np.diag([-1.0, 1.0, -1.0]))
NONE = SymmetryGroup()
TWOFOLD = SymmetryGroup(np.stack([np.eye(4), HALF_TURN]))
ROUND = SymmetryGroup(axes=(ContinuousAxis(Z, np.array([0.01, 0.02, 0.0])),))
CAN = SymmetryGroup(TWOFOLD.discrete, (ContinuousAxis(Z, np.zeros(3)),))
BALL = SymmetryGroup(
    axes=(
        ContinuousAxis(Z, np.array([0.03, 0.0, 0.0])),
        ContinuousAxis(np.array([1.0, 0.0, 0.0]), np.zeros(3)),
    )
)
GROUPS = {"none": NONE, "twofold": TWOFOLD, "round": ROUND, "can": CAN, "ball": BALL}
CAMERA = CameraIntrinsics(640, 480, 600.0, 600.0, 320.0, 240.0)


@st.composite
def poses(draw: st.DrawFn) -> Array:
    seed = draw(st.integers(0, 10**6))
    rng = np.random.default_rng(seed)
    xi = np.concatenate([rng.normal(size=3) * 2, rng.uniform(-0.2, 0.2, 3)])
    return make_pose(p=[0.0, 0.0, 0.8]) @ exp_pose(xi)


def element(group: SymmetryGroup, angle: float, index: int) -> Array:
    """A symmetry of the group."""
    X = group.discrete[index % len(group.discrete)]
    for axis in group.axes:
        X = axis.pose(angle) @ X
    return X


@pytest.mark.parametrize("name", GROUPS)
@settings(deadline=None, max_examples=25)
@given(X_CO=poses(), angle=st.floats(-3.1, 3.1), index=st.integers(0, 1))
def test_symmetric_poses_are_equal(
    name: str, X_CO: Array, angle: float, index: int
) -> None:
    group = GROUPS[name]
    error = pose_error(X_CO, X_CO @ element(group, angle, index), group)
    assert error.geodesic == pytest.approx(0, abs=1e-6)
    assert error.translation == pytest.approx(0, abs=1e-6)
    assert error.rpy_mean == pytest.approx(0, abs=1e-5)
    assert error.within(np.radians(0.1), 1e-4)


@pytest.mark.parametrize("name", GROUPS)
@settings(deadline=None, max_examples=25)
@given(X_CA=poses(), X_CB=poses())
def test_the_geodesic_is_the_distance_of_the_group(
    name: str, X_CA: Array, X_CB: Array
) -> None:
    group = GROUPS[name]
    error = pose_error(X_CA, X_CB, group)
    expected = group.rotation_distance(X_CA[:3, :3], X_CB[:3, :3]).item()
    assert error.geodesic == pytest.approx(expected, abs=1e-6)


@settings(deadline=None, max_examples=25)
@given(X_CA=poses(), X_CB=poses())
def test_no_sampled_symmetry_beats_the_rpy_search(X_CA: Array, X_CB: Array) -> None:
    R = X_CA[:3, :3].T @ X_CB[:3, :3]
    sampled = np.swapaxes(CAN.sampled(720)[:, :3, :3], 1, 2) @ R
    found = pose_error(X_CA, X_CB, CAN).rpy_mean
    assert found <= mean_rpy(sampled).min() + np.radians(0.2)


def test_known_errors() -> None:
    X_AB = exp_pose(np.array([0.3, 0.0, 0.0, 0.0, 0.04, 0.03]))
    error = pose_error(np.eye(4), X_AB, NONE)
    assert error.geodesic == pytest.approx(0.3)
    assert error.rpy_mean == pytest.approx(0.1)
    assert error.translation == pytest.approx(0.05)
    assert error.within(0.31, 0.051)
    assert not error.within(0.31, 0.049)


def test_any_symmetry_may_be_within_the_limits() -> None:
    # Turned by 91 of 180 degrees the second symmetry is nearer in angle; only the
    # first is near in place, because the turn carries the origin away.
    turn = make_pose(np.diag([-1.0, -1.0, 1.0]), [0.2, 0.0, 0.0])
    group = SymmetryGroup(np.stack([np.eye(4), turn]))
    X_AB = make_pose(Rotation.from_rotvec(np.radians(91) * Z).as_matrix())
    error = pose_error(np.eye(4), X_AB, group)
    assert error.geodesic == pytest.approx(np.radians(89))
    assert error.translation == pytest.approx(0.2)
    assert error.within(np.radians(92), 0.01)


def test_mean_rpy_at_the_pole() -> None:
    R = Rotation.from_euler("ZYX", [0, 90, 30], degrees=True).as_matrix()
    assert mean_rpy(R) == pytest.approx(np.radians(40))


@given(X_CA=poses(), X_CB=poses())
@settings(deadline=None, max_examples=25)
def test_add_s_is_at_most_add(X_CA: Array, X_CB: Array) -> None:
    points = np.random.default_rng(0).normal(size=(40, 3)) * 0.05
    assert add_s(points, X_CA, X_CB) <= add(points, X_CA, X_CB) + 1e-12
    X_shift = make_pose(p=[0.003, 0, 0.004])
    assert add(points, X_CA, X_shift @ X_CA) == pytest.approx(0.005)


@pytest.mark.parametrize("name", ["none", "twofold", "ball"])
@settings(deadline=None, max_examples=20)
@given(X_CA=poses(), X_CB=poses())
def test_hull_vertices_give_the_same_mssd(name: str, X_CA: Array, X_CB: Array) -> None:
    mesh = trimesh.creation.annulus(0.02, 0.05, 0.04, sections=12)
    X_OS = symmetry_samples(GROUPS[name], X_CA, X_CB)
    whole = mssd(mesh.vertices, X_CA, X_CB, X_OS)
    assert mssd(mesh.convex_hull.vertices, X_CA, X_CB, X_OS) == pytest.approx(whole)


def test_distances_of_a_shift() -> None:
    # A cylinder turned about its axis by any angle and moved by 6 mm, at 0.6 m.
    can = trimesh.creation.cylinder(0.03, 0.1, sections=64).vertices
    X_CA = make_pose(p=[0.0, 0.0, 0.6])
    turn = make_pose(Rotation.from_rotvec(1.0 * Z).as_matrix())
    X_CB = make_pose(p=[0.006, 0.0, 0.0]) @ X_CA @ turn
    X_OS = symmetry_samples(CAN, X_CA, X_CB)
    assert mssd(can, X_CA, X_CB, X_OS) == pytest.approx(0.006, abs=3e-4)
    # The near end, at 0.55 m, moves farthest in the image.
    pixels = mspd(can, X_CA, X_CB, X_OS, CAMERA)
    assert pixels == pytest.approx(600 * 0.006 / 0.55, abs=0.4)


def test_a_turned_ball_moves_by_its_centres() -> None:
    centre = np.array([0.03, 0.0, 0.0])
    ball = trimesh.creation.icosphere(2, 0.03).vertices + centre
    X_CA = make_pose(p=[0.0, 0.0, 0.6])
    R = Rotation.from_rotvec([1.0, 2.0, 0.5]).as_matrix()
    X_CB = X_CA @ make_pose(R, centre - R @ centre + [0.0, 0.005, 0.0])
    X_OS = symmetry_samples(BALL, X_CA, X_CB)
    assert mssd(ball, X_CA, X_CB, X_OS) == pytest.approx(0.005)
    error = pose_error(X_CA, X_CB, BALL)
    assert (error.rpy_mean, error.geodesic) == (0, 0)
    assert error.translation == pytest.approx(0.005)
