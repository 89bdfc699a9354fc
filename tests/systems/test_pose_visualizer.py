# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator

from physim_drake.observation.observation import RgbdObservation
from physim_drake.poses import inverse
from physim_drake.rendering.meshcat import confidence_color, draw_cloud
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from physim_drake.systems.pose_visualizer import PoseVisualizer, PoseVisualizerConfig
from physim_drake.systems.stamped import Stamped
from tests.synthetic import GLUE, SOAP, SyntheticScene, library, pair_apart, synthesize
from tests.systems.looks import build


@pytest.fixture(scope="module")
def meshcat() -> Meshcat:
    return Meshcat()


@pytest.fixture(scope="module")
def made() -> SyntheticScene:
    return synthesize(pair_apart())


def estimate(made: SyntheticScene, confidence: float) -> SceneEstimate:
    found = ObjectEstimate(GLUE, "glue", made.X_WO[0], made.X_WO[0], confidence, "")
    missing = ObjectEstimate(SOAP, "soap", None, None, 0.0, "hidden")
    return SceneEstimate((found, missing), made.surface, "fake", {})


class Shown:
    """A visualizer whose input ports are set by hand."""

    def __init__(self, meshcat: Meshcat, config: PoseVisualizerConfig) -> None:
        self._visualizer = PoseVisualizer(meshcat, library(), config)
        diagram = build(self._visualizer)
        self._context = diagram.CreateDefaultContext()
        self._simulator = Simulator(diagram, self._context)

    def show(self, number: int, observation: Any, result: Any, error: str = "") -> None:
        inner = self._visualizer.GetMyMutableContextFromRoot(self._context)
        for port, value in (("observation", observation), ("scene_estimate", result)):
            stamped: Stamped[Any] = Stamped(value, 0.0, number, error)
            self._visualizer.GetInputPort(port).FixValue(inner, stamped)
        self._simulator.AdvanceTo(self._simulator.get_context().get_time() + 1.0)


def test_each_estimate_replaces_the_one_before(
    meshcat: Meshcat, made: SyntheticScene
) -> None:
    shown = Shown(meshcat, PoseVisualizerConfig("/test"))
    shown.show(1, made.observation, estimate(made, 0.9))
    assert meshcat.HasPath("/test/estimate/0 glue 0.90")
    assert not meshcat.HasPath("/test/estimate/1 soap 0.00")
    assert meshcat.HasPath("/test/cloud")
    shown.show(2, made.observation, estimate(made, 0.4))
    assert meshcat.HasPath("/test/estimate/0 glue 0.40")
    assert not meshcat.HasPath("/test/estimate/0 glue 0.90")
    shown.show(3, made.observation, None, "no surface")
    assert not meshcat.HasPath("/test")


def test_a_history_keeps_every_look_of_a_simulation(
    meshcat: Meshcat, made: SyntheticScene
) -> None:
    config = PoseVisualizerConfig("/history", cloud=False, history=True)
    shown = Shown(meshcat, config)
    shown.show(1, made.observation, estimate(made, 0.9))
    shown.show(2, made.observation, estimate(made, 0.4))
    assert meshcat.HasPath("/history/look 1/estimate/0 glue 0.90")
    assert meshcat.HasPath("/history/look 2/estimate/0 glue 0.40")
    Shown(meshcat, config).show(1, made.observation, estimate(made, 0.7))
    assert meshcat.HasPath("/history/look 1/estimate/0 glue 0.70")
    assert not meshcat.HasPath("/history/look 2")


def test_nothing_is_drawn_again_before_there_is_something_new(
    meshcat: Meshcat, made: SyntheticScene
) -> None:
    shown = Shown(meshcat, PoseVisualizerConfig("/once", cloud=False))
    shown.show(1, made.observation, estimate(made, 0.9))
    assert not meshcat.HasPath("/once/cloud")
    meshcat.Delete("/once")
    shown.show(1, made.observation, estimate(made, 0.9))
    assert not meshcat.HasPath("/once")


def test_without_a_camera_pose_the_cloud_is_drawn_over_the_surface(
    meshcat: Meshcat, made: SyntheticScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    poses = []

    def take_down(
        meshcat: Any, path: str, observation: Any, X_WC: Any, *_: Any
    ) -> None:
        poses.append(X_WC)

    monkeypatch.setattr("physim_drake.systems.pose_visualizer.draw_cloud", take_down)
    shown = Shown(meshcat, PoseVisualizerConfig("/surface"))
    unknown = replace(made.observation, X_WC=None)
    shown.show(1, unknown, estimate(made, 0.9))
    surface = made.surface
    np.testing.assert_allclose(poses[0], surface.X_WS @ inverse(surface.X_CS))


def test_a_cloud_has_the_points_and_colours_of_its_image(made: SyntheticScene) -> None:
    drawn: dict[str, Any] = {}

    class Fake:
        def SetObject(self, path: str, cloud: Any, point_size: float) -> None:
            drawn["cloud"] = cloud

    seen = made.observation
    color = np.zeros((*seen.depth.shape, 3), np.uint8)
    color[..., 1] = 200
    X_WC = seen.X_WC
    assert X_WC is not None
    painted = RgbdObservation(seen.depth, seen.intrinsics, color, X_WC)
    draw_cloud(Fake(), "/cloud", painted, X_WC, stride=4)  # type: ignore[arg-type]
    cloud = drawn["cloud"]
    assert cloud.size() == np.count_nonzero(seen.depth[::4, ::4])
    assert (cloud.rgbs().T == [0, 200, 0]).all()
    heights = cloud.xyzs()[2]
    assert -0.02 < heights.min() < 0.02
    assert 0.03 < heights.max() < 0.1


def test_confidence_goes_from_red_to_green() -> None:
    colors = [confidence_color(c) for c in (-1.0, 0.0, 0.25, 0.5, 1.0)]
    rgb = [(c.r(), c.g(), c.b()) for c in colors]
    assert rgb == [(1, 0, 0), (1, 0, 0), (1, 0.5, 0), (1, 1, 0), (0, 1, 0)]
    assert confidence_color(0.5, 0.3).a() == 0.3
