# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physim_drake.camera import DepthImage
from physim_drake.errors import InputError
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.observation.support_surface import (
    NoSurfaceError,
    SupportSurface,
    find_support_surface,
    heights_above,
    no_surface,
    surface_at_height,
)
from physim_drake.poses import Array, inverse, make_pose, transform_points
from physim_drake.search.states import composite
from tests.synthetic import (
    CAMERA,
    COFFEE,
    GLUE,
    TISSUES,
    X_WC,
    Objects,
    look_at,
    noisy,
    plane_depth,
    resting,
    stack,
    synthesize,
    turned,
)

LOW_X_WC = look_at([0.0, -0.8, 0.35], [0.0, 0.0, 0.1])


def clutter() -> Objects:
    upright = turned("x", 90)
    return (
        *stack(),
        (COFFEE, resting(COFFEE, upright, -0.13, 0.03)),
        (TISSUES, resting(TISSUES, turned("z", 10), 0.13, 0.06)),
        (GLUE, resting(GLUE, turned("z", 50), 0.06, -0.08)),
    )


def errors(surface: SupportSurface, X_WC: Array, height: float = 0.0) -> Array:
    """Degrees from the vertical, and mm from the height, of a found table."""
    X_WS = X_WC @ surface.X_CS
    tilt = np.degrees(np.arccos(np.clip(X_WS[2, 2], -1, 1)))
    return np.array([tilt, 1e3 * abs(X_WS[2, 3] - height)])


def on_a_narrow_table(floor: float, wall: float, far_edge: float = 0.25) -> DepthImage:
    """A table of 60 x 50 cm, or less, before a wall, over a floor at this height."""
    image = np.zeros((CAMERA.height, CAMERA.width), dtype=np.float32)
    table = plane_depth(CAMERA, LOW_X_WC, [0.0, 0.0, 1.0], 0.0)
    p_W = transform_points(LOW_X_WC, CAMERA.unproject(table).reshape(-1, 3))
    on_table = (np.abs(p_W[:, 0]) < 0.3) & (p_W[:, 1] > -0.25) & (p_W[:, 1] < far_edge)
    table = np.where(on_table.reshape(table.shape), table, 0).astype(np.float32)
    for other in (
        table,
        plane_depth(CAMERA, LOW_X_WC, [0.0, 0.0, 1.0], floor),
        plane_depth(CAMERA, LOW_X_WC, [0.0, 1.0, 0.0], wall),
    ):
        image = composite(image, other)
    return image


@pytest.mark.parametrize("known_pose", [True, False])
def test_the_table_among_clutter(known_pose: bool) -> None:
    made = synthesize(clutter(), noise=1.0)
    observation = made.observation
    if not known_pose:
        observation = replace(observation, X_WC=None)
    surface = find_support_surface(observation, made.detections)
    assert (errors(surface, X_WC) < [0.3, 1.5]).all()


@pytest.mark.parametrize("turn", [[4, 0], [-4, 0], [0, 4], [3, -3]])
def test_a_camera_pose_4_degrees_off_does_not_tilt_the_table(turn: list[float]) -> None:
    made = synthesize(clutter(), noise=0.5)
    off = make_pose(turned("xy", *turn)) @ X_WC
    observation = replace(made.observation, X_WC=off)
    surface = find_support_surface(observation, made.detections)
    assert (errors(surface, X_WC) < [0.3, 1.5]).all()
    # In the world as given, the found table is as tilted as that world is.
    np.testing.assert_allclose(surface.X_WS, off @ surface.X_CS)


@pytest.mark.parametrize("known_pose", [True, False])
def test_neither_the_floor_nor_the_wall_is_the_table(known_pose: bool) -> None:
    background = on_a_narrow_table(floor=-0.75, wall=0.9)
    made = synthesize(clutter(), X_WC=LOW_X_WC, table=background)
    observation = made.observation
    if not known_pose:
        observation = replace(observation, X_WC=None)
    surface = find_support_surface(observation, made.detections)
    assert (errors(surface, LOW_X_WC) < [0.4, 2.0]).all()


def test_a_box_may_show_the_floor_behind_the_table() -> None:
    background = on_a_narrow_table(floor=-0.75, wall=3.0, far_edge=0.08)
    tall = [(COFFEE, resting(COFFEE, turned("x", 90), 0.0, 0.02))]
    made = synthesize(tall, X_WC=LOW_X_WC, table=background)
    (detection,) = made.detections
    wider = detection.box + np.array([-25.0, 0.0, 25.0, 0.0])
    surface = find_support_surface(
        replace(made.observation, X_WC=None), [replace(detection, box=wider)]
    )
    assert (errors(surface, LOW_X_WC) < [0.4, 2.0]).all()


def test_a_big_object_s_top_is_not_the_table() -> None:
    # Little of the table is seen, much less than of the box's top.
    table = plane_depth(CAMERA, X_WC, [0.0, 0.0, 1.0], 0.0)
    box = [(TISSUES, resting(TISSUES, np.eye(3), 0.0, 0.0))]
    left, top, right, bottom = synthesize(box).detections[0].box.astype(int)
    around = np.zeros_like(table)
    rows, columns = slice(top, bottom + 2), slice(left - 2, right + 2)
    around[rows, columns] = table[rows, columns]
    made = synthesize(box, table=around)
    assert np.count_nonzero(made.masks[0]) > 2 * np.count_nonzero(
        (made.ideal_depth > 0) & ~made.masks[0]
    )
    surface = find_support_surface(made.observation, made.detections)
    assert (errors(surface, X_WC) < [0.5, 2.5]).all()


def test_the_same_generator_gives_the_same_surface() -> None:
    made = synthesize(clutter())
    first, second = (
        find_support_surface(
            made.observation, made.detections, np.random.default_rng(3)
        )
        for _ in range(2)
    )
    np.testing.assert_array_equal(first.X_CS, second.X_CS)


def test_the_frame_lies_on_the_table_where_the_camera_looks() -> None:
    made = synthesize(stack(), noise=0.0)
    surface = find_support_surface(made.observation, made.detections)
    X_CS = surface.X_CS
    np.testing.assert_allclose(X_CS[:3, :3] @ X_CS[:3, :3].T, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(X_CS[:2, 3], 0, atol=1e-12)
    assert X_CS[2, 3] > 0
    assert X_CS[0, 0] > 0.9
    assert surface.X_SC[2, 3] == pytest.approx(0.55, abs=1e-3)


def test_a_wall_alone_is_no_table() -> None:
    X = look_at([0.0, -1.0, 0.5], [0.0, 0.0, 0.5])
    wall = plane_depth(CAMERA, X, [0.0, 1.0, 0.0], 0.0)
    observation = RgbdObservation(wall, CAMERA, None, X)
    with pytest.raises(InputError, match="no plane"):
        find_support_surface(observation)
    # Without a camera pose, nothing says that it is not one.
    assert find_support_surface(replace(observation, X_WC=None)).X_CS[2, 3] > 0.9


def test_too_little_depth_is_said() -> None:
    depth = np.zeros((CAMERA.height, CAMERA.width), dtype=np.float32)
    depth[100, 100:105] = 0.5
    with pytest.raises(InputError, match="depth points near the objects"):
        find_support_surface(RgbdObservation(depth, CAMERA, name="frame"))


def test_detections_off_the_image_are_said() -> None:
    made = synthesize(stack())
    nowhere = Detection(1, np.array([900.0, 900.0, 950.0, 950.0]))
    with pytest.raises(InputError, match="check the detections"):
        find_support_surface(made.observation, [nowhere])


@pytest.mark.parametrize("height", [0.0, 0.1])
def test_a_given_height_is_taken(height: float) -> None:
    made = synthesize(stack())
    surface = surface_at_height(made.observation, height)
    np.testing.assert_allclose(surface.X_WS, X_WC @ surface.X_CS)
    assert surface.X_WS[2, 3] == pytest.approx(height, abs=1e-9)
    np.testing.assert_allclose(surface.X_WS[:3, 2], [0, 0, 1], atol=1e-9)
    p_W = np.array([[0.1, 0.2, 0.3], [0.0, 0.0, height]])
    p_C = transform_points(inverse(X_WC), p_W)
    np.testing.assert_allclose(
        heights_above(surface, p_C), [0.3 - height, 0], atol=1e-9
    )


def test_a_height_needs_the_camera_s_pose() -> None:
    observation = replace(synthesize(stack()).observation, X_WC=None)
    with pytest.raises(InputError, match="needs the camera's pose"):
        surface_at_height(observation, 0.0)


def test_a_noisy_floor_is_found_to_a_tenth_of_a_degree() -> None:
    table = plane_depth(CAMERA, X_WC, [0.0, 0.0, 1.0], 0.0)
    observation = RgbdObservation(noisy(table, 1.0, 0), CAMERA, None, X_WC)
    assert (errors(find_support_surface(observation), X_WC) < [0.1, 0.5]).all()


def test_a_camera_whose_pose_is_the_identity_is_doubted_and_the_table_found() -> None:
    made = synthesize(clutter(), X_WC=X_WC)
    observation = replace(made.observation, X_WC=np.eye(4))
    surface = find_support_surface(observation, made.detections)
    assert "cam_R_w2c" in surface.warning
    assert errors(surface, X_WC)[0] < 0.5


def test_a_right_camera_pose_is_not_doubted() -> None:
    made = synthesize(clutter())
    assert find_support_surface(made.observation, made.detections).warning == ""


def test_planes_on_the_objects_alone_are_no_surface() -> None:
    made = synthesize(stack())
    seen = np.logical_or.reduce(made.masks)
    cut = replace(
        made.observation, depth=np.where(seen, made.observation.depth, np.float32(0))
    )
    with pytest.raises(NoSurfaceError, match="no plane found under the objects"):
        find_support_surface(cut, made.detections)


def test_no_surface_lies_behind_the_scene_and_keeps_the_world() -> None:
    observation = synthesize(stack()).observation
    surface = no_surface(observation)
    assert not surface.known
    assert heights_above(surface, np.array([0.0, 0.0, observation.depth.max()])) > 0
    np.testing.assert_allclose(surface.X_WS @ surface.X_SC, X_WC, atol=1e-12)
    assert "gravity" in surface.warning
