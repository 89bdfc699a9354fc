# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import FrameId
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import (
    CameraConfig,
    ImageDepth32F,
    ImageLabel16I,
    ImageRgba8U,
    RgbdSensor,
)

from physim_drake.camera import CameraIntrinsics
from physim_drake.errors import InputError
from physim_drake.observation.observation import RgbdObservation
from physim_drake.sensors.presets import PRESETS, CameraName
from physim_drake.systems.camera_source import CameraSource, CameraSourceConfig
from tests.systems.looks import Clock, shown

WIDTH, HEIGHT = 160, 120
SMALL = CameraSourceConfig(width=WIDTH, height=HEIGHT)
PERFECT = replace(SMALL, depth_noise=False, color_noise=False)
X_WC = RigidTransform([0.1, 0.2, 0.3])


def image(kind: Any, values: Any) -> Any:
    made = kind(WIDTH, HEIGHT)
    made.mutable_data[:] = values
    return made


def scene() -> dict[str, Any]:
    """A box 0.6 m away before a wall at 0.7 m, with nothing beside them."""
    depth = np.full((HEIGHT, WIDTH, 1), 0.7, dtype=np.float32)
    depth[40:80, 60:100] = 0.6
    depth[:, :20] = np.inf
    labels = np.where(depth == np.float32(0.6), 3, 0)
    return {
        "color_image": image(ImageRgba8U, [90, 120, 150, 255]),
        "depth_image_32f": image(ImageDepth32F, depth),
        "label_image": image(ImageLabel16I, labels),
        "X_WC": X_WC,
    }


def looks(
    config: CameraSourceConfig,
    inputs: dict[str, Any],
    count: int = 1,
    port: str = "observation",
    camera: CameraIntrinsics | None = None,
) -> list[Any]:
    """What a port shows after each of several looks."""
    builder = DiagramBuilder()
    source = CameraSource(camera or config.intrinsics, config, period=1.0)
    system = builder.AddNamedSystem("camera", source)
    builder.AddNamedSystem("clock", Clock())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    inner = system.GetMyMutableContextFromRoot(context)
    for name, value in inputs.items():
        system.GetInputPort(name).FixValue(inner, value)
    simulator = Simulator(diagram, context)
    seen = []
    for n in range(count):
        simulator.AdvanceTo(n + 0.5)
        seen.append(shown(system, context, port))
    return seen


def test_without_noise_an_observation_is_what_the_sensor_gave() -> None:
    (stamped,) = looks(PERFECT, scene())
    seen: RgbdObservation = stamped.value
    assert (stamped.number, stamped.time) == (1, 0.0)
    assert (seen.depth[:, :20] == 0).all()
    assert seen.depth[60, 80] == np.float32(0.6)
    assert seen.depth[10, 80] == np.float32(0.7)
    assert seen.color is not None
    assert (seen.color == [90, 120, 150]).all()
    np.testing.assert_allclose(seen.X_WC, X_WC.GetAsMatrix4())
    assert seen.name == "look 1"
    for pixels in (seen.depth, seen.color):
        assert not pixels.flags.writeable


def test_labels_go_with_the_look_where_they_are_known() -> None:
    (stamped,) = looks(PERFECT, scene(), port="labels")
    assert stamped.value.shape == (HEIGHT, WIDTH)
    assert stamped.value.dtype == np.int16
    assert stamped.value[60, 80] == 3
    unknown = {name: v for name, v in scene().items() if name != "label_image"}
    (stamped,) = looks(PERFECT, unknown, port="labels")
    assert (stamped.value, stamped.number, stamped.error) == (None, 1, "")


def test_each_look_has_its_own_noise_always_the_same() -> None:
    first, second = (s.value for s in looks(SMALL, scene(), 2))
    again, third = (s.value for s in looks(SMALL, scene(), 2))
    np.testing.assert_array_equal(first.depth, again.depth)
    np.testing.assert_array_equal(first.color, again.color)
    np.testing.assert_array_equal(second.depth, third.depth)
    assert (first.depth != second.depth).mean() > 0.3
    assert (first.color != second.color).mean() > 0.3
    (other,) = (s.value for s in looks(replace(SMALL, seed=1), scene()))
    assert (first.depth != other.depth).mean() > 0.3


def test_depth_errs_as_the_preset_says() -> None:
    (stamped,) = looks(replace(SMALL, color_noise=False), scene())
    wall = stamped.value.depth[5:35, 25:150]
    spread = float(np.std(wall[wall > 0] - 0.7))
    sigma = float(PRESETS[CameraName.D415].noise.sigma(np.array(0.7)))
    assert 0.5 * sigma < spread < 2 * sigma
    assert (stamped.value.color == [90, 120, 150]).all()


def test_black_surfaces_are_lost_where_reflections_count() -> None:
    dark = scene() | {"echo_image": image(ImageRgba8U, [2, 2, 2, 255])}
    holes = {}
    for reflections in (True, False):
        (stamped,) = looks(replace(SMALL, reflections=reflections), dark)
        holes[reflections] = float((stamped.value.depth[5:35, 25:150] == 0).mean())
    assert holes[True] > 0.1
    assert holes[False] < 0.02


def test_an_image_without_depth_is_a_look_with_an_error() -> None:
    nothing = scene()
    nothing["depth_image_32f"] = image(ImageDepth32F, np.inf)
    (stamped,) = looks(PERFECT, nothing)
    assert stamped.value is None
    assert "look 1: depth: is zero everywhere" in stamped.error


def test_an_image_of_another_size_is_a_look_with_an_error() -> None:
    config = replace(PERFECT, width=80, height=60)
    (stamped,) = looks(config, scene())
    assert "look 1: depth: has (120, 160) pixels" in stamped.error


def drake_camera() -> Any:
    """Drake's default field of view, which is none of the presets'."""
    camera: Any = CameraConfig()
    camera.width, camera.height, camera.center_x = WIDTH, HEIGHT, 70.0
    return camera


def rgbd_sensor(camera: CameraConfig) -> RgbdSensor:
    return RgbdSensor(FrameId.get_new_id(), RigidTransform(), *camera.MakeCameras())


@pytest.mark.parametrize("make", [drake_camera, lambda: rgbd_sensor(drake_camera())])
def test_intrinsics_are_those_of_the_camera(make: Any) -> None:
    builder = DiagramBuilder()
    source = builder.AddNamedSystem(
        "source", CameraSource(make(), CameraSourceConfig(), period=1.0)
    )
    builder.AddNamedSystem("clock", Clock())
    diagram = builder.Build()
    simulator = Simulator(diagram)
    inner = source.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    for name, value in scene().items():
        source.GetInputPort(name).FixValue(inner, value)
    simulator.AdvanceTo(0.5)
    seen = shown(source, simulator.get_context(), "observation").value.intrinsics
    focal = drake_camera().focal_y()
    assert seen == CameraIntrinsics(WIDTH, HEIGHT, focal, focal, 69.5, 59.0)


def test_the_size_of_the_image_is_the_cameras() -> None:
    with pytest.raises(InputError, match="width"):
        CameraSource(drake_camera(), CameraSourceConfig(width=320))


def test_colour_and_depth_of_other_intrinsics_are_refused() -> None:
    color, _ = drake_camera().MakeCameras()
    _, wide = CameraConfig().MakeCameras()
    sensor = RgbdSensor(FrameId.get_new_id(), RigidTransform(), color, wide)
    with pytest.raises(InputError, match="colour and depth differ"):
        CameraSource(sensor)


def test_what_makes_the_images_must_be_given() -> None:
    with pytest.raises(TypeError, match="RgbdSensor"):
        CameraSource(SMALL)  # type: ignore[arg-type]


def test_a_smaller_image_shows_the_same_field() -> None:
    full, half = PRESETS[CameraName.D415].intrinsics, CameraSourceConfig(width=320)
    K = replace(half, height=240).intrinsics
    assert (K.width, K.height) == (320, 240)
    for u, v in ((-0.5, -0.5), (639.5, 479.5), (100.0, 300.0)):
        ray = ((u - full.cx) / full.fx, (v - full.cy) / full.fy)
        assert ((u + 0.5) / 2 - 0.5 - K.cx) / K.fx == pytest.approx(ray[0])
        assert ((v + 0.5) / 2 - 0.5 - K.cy) / K.fy == pytest.approx(ray[1])
    assert CameraSourceConfig().intrinsics == full


def test_a_camera_keeps_its_extrinsic_error() -> None:
    X_CD = SMALL.draw_extrinsic_error()
    np.testing.assert_array_equal(X_CD, SMALL.draw_extrinsic_error())
    assert 1e-5 < np.linalg.norm(X_CD[:3, 3]) < 2e-3
    assert (PERFECT.draw_extrinsic_error() == np.eye(4)).all()


def test_an_image_has_pixels() -> None:
    with pytest.raises(InputError, match="camera: width: is 0"):
        CameraSourceConfig(width=0)
