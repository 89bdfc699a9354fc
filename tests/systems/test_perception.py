# SPDX-License-Identifier: MIT
"""The whole diagram: on a real plant, with a real and with a fake estimator."""

from __future__ import annotations

import multiprocessing
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.common.schema import Transform
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from physim_drake.detection.detector import NetworkDetector
from physim_drake.detection.networks.factory import ObjectClass
from physim_drake.errors import InputError
from physim_drake.estimation.estimator import Method
from physim_drake.estimation.preparation import PreparedScene
from physim_drake.hypotheses.generation import PoseHypotheses
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.observation import Detection
from physim_drake.observation.segmented_scene import prepare_scene
from physim_drake.observation.support_surface import surface_at_height
from physim_drake.poses import Array, inverse
from physim_drake.rendering.depth import DepthRenderer
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from physim_drake.systems.perception import AddPerceptionDiagram, PerceptionDiagram
from physim_drake.systems.perception_config import (
    EstimatorConfig,
    LatencyConfig,
    NetworkDetectorConfig,
    OracleDetectorConfig,
    PerceptionCameraConfig,
    PerceptionConfig,
)
from tests.cli.test_detect import write_weights_of
from tests.synthetic import ERASER, SOAP, library
from tests.systems.tables import (
    ERASER_NAME,
    SOAP_NAME,
    X_WC,
    add_table,
    camera_transform,
    soap_and_eraser,
)

SMALL = PerceptionConfig(
    camera=PerceptionCameraConfig(width=320, height=240, X_PB=camera_transform()),
    detector=OracleDetectorConfig(),
    estimator=EstimatorConfig(expansions=12, representatives=8, rounds=1),
)


class Weigher:
    """Estimates nothing, but says with what confidence by the image."""

    def prepare(
        self, observation: Any, detections: Any, surface_height: float | None = None
    ) -> PreparedScene:
        surface = surface_at_height(observation, 0.0)
        scene = prepare_scene(observation, surface, detections)
        return PreparedScene(observation, detections, surface, scene)

    def hypotheses(self, prepared: PreparedScene) -> list[PoseHypotheses]:
        none = np.zeros((0, 4, 4)), np.zeros(0), np.zeros(0, dtype=np.int64)
        return [PoseHypotheses(d.object_id, *none) for d in prepared.detections]

    def estimate_prepared(
        self, prepared: PreparedScene, hypotheses: Any = None
    ) -> SceneEstimate:
        return self.estimate(prepared.observation, prepared.detections)

    def estimate(
        self, observation: Any, detections: Any, surface_height: float | None = None
    ) -> SceneEstimate:
        weight = float(observation.depth.mean()) + sum(d.box.sum() for d in detections)
        objects = tuple(
            ObjectEstimate(d.object_id, "", np.eye(4), np.eye(4), weight, "")
            for d in detections
        )
        return SceneEstimate(objects, surface_at_height(observation, 0.0), "fake", {})


@cache
def two_objects() -> ObjectLibrary:
    return ObjectLibrary([library()[SOAP], library()[ERASER]], "two")


class World:
    """A table with objects, perception of them, and a simulation."""

    def __init__(
        self,
        X_WO: Mapping[str, Array],
        config: PerceptionConfig = SMALL,
        **options: Any,
    ) -> None:
        builder = DiagramBuilder()
        add_table(builder, X_WO)
        options = {"library": two_objects()} | options
        self.perception: Any = AddPerceptionDiagram(builder, config, **options)
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.context = self.simulator.get_context()
        self.trigger(0.0)

    def trigger(self, value: float) -> None:
        inner = self.perception.GetMyContextFromRoot(self.context)
        self.perception.GetInputPort("trigger").FixValue(inner, value)

    def shown(self, port: str, context: Any = None) -> Any:
        root = self.context if context is None else context
        inner = self.perception.GetMyContextFromRoot(root)
        return self.perception.GetOutputPort(port).Eval(inner)


def test_an_object_on_a_table_is_found() -> None:
    soap = {SOAP_NAME: soap_and_eraser()[SOAP_NAME]}
    world = World(soap)
    with world.perception:
        world.simulator.AdvanceTo(0.1)
        assert world.shown("scene_estimate").number == 0
        world.trigger(1.0)
        world.simulator.AdvanceTo(0.2)
    estimate = world.shown("scene_estimate")
    assert (estimate.number, estimate.time, estimate.error) == (1, 0.1, "")
    (found,) = estimate.value.objects
    assert found.confidence > 0.8
    np.testing.assert_allclose(found.X_WO, X_WC @ found.X_CO, atol=1e-9)
    (look,) = world.shown("pose_errors").value
    assert look.objects[0].name == SOAP_NAME
    assert look.objects[0].translation < 0.005
    assert np.degrees(look.objects[0].rotation) < 5.0
    hypotheses = world.shown("hypotheses").value
    assert hypotheses.objects[0].object_id == SOAP
    assert len(hypotheses.objects[0].representatives) == 8


def test_the_camera_sees_the_objects_where_they_are() -> None:
    camera = replace(SMALL.camera, depth_noise=False, color_noise=False)
    world = World(soap_and_eraser(), replace(SMALL, camera=camera), estimator=Weigher())
    world.trigger(1.0)
    world.simulator.AdvanceTo(0.02)
    observation = world.shown("observation").value
    labels = world.shown("labels").value
    true_poses = world.shown("look_poses").value
    np.testing.assert_allclose(observation.X_WC, X_WC, atol=1e-9)
    renderer = DepthRenderer(two_objects(), observation.intrinsics)
    assert len(world.perception.instances) == 2
    for instance in world.perception.instances:
        X_CO = inverse(X_WC) @ true_poses[instance.name]
        alone = renderer.render(instance.object_id, X_CO)
        seen = labels == instance.body_index
        assert seen.sum() > 500
        assert (seen == (alone > 0)).mean() > 0.999
        both = seen & (alone > 0)
        assert np.abs(observation.depth - alone)[both].max() < 1e-3


def test_looks_go_through_all_ports_in_step() -> None:
    latency = LatencyConfig(camera=0.01, detector=0.05, hypotheses=0.1, estimator=0.2)
    config = replace(SMALL, period=0.1, latency=latency)
    world = World(soap_and_eraser(), config, estimator=Weigher())
    world.simulator.AdvanceTo(0.7)
    last = {
        name: world.shown(name).number
        for name in ("observation", "detections", "hypotheses", "scene_estimate")
    }
    assert last == {
        "observation": 7,
        "detections": 7,
        "hypotheses": 6,
        "scene_estimate": 4,
    }
    errors = world.shown("pose_errors").value
    assert [e.number for e in errors] == [1, 2, 3, 4]
    assert [e.time for e in errors] == pytest.approx([0.0, 0.1, 0.2, 0.3])


def confidences(world: World, context: Any = None) -> list[float]:
    estimate = world.shown("scene_estimate", context).value
    return [o.confidence for o in estimate.objects]


def test_the_same_world_is_seen_alike() -> None:
    seen = []
    for _ in range(2):
        world = World(
            soap_and_eraser(), replace(SMALL, period=0.1), estimator=Weigher()
        )
        world.simulator.AdvanceTo(0.25)
        seen.append(confidences(world))
    assert seen[0] == seen[1]
    assert len(seen[0]) == 2


def test_a_copy_of_the_context_is_seen_like_the_original() -> None:
    world = World(
        soap_and_eraser(),
        replace(SMALL, period=0.1, latency=LatencyConfig(detector=0.03)),
        estimator=Weigher(),
    )
    world.simulator.AdvanceTo(0.12)
    clone = Simulator(world.diagram, world.context.Clone())
    world.simulator.AdvanceTo(0.25)
    first = confidences(world)
    clone.AdvanceTo(0.25)
    assert world.shown("scene_estimate", clone.get_context()).number == 3
    assert confidences(world, clone.get_context()) == first


def test_a_camera_may_be_mounted_on_a_body() -> None:
    mounted = RigidTransform(soap_and_eraser()[SOAP_NAME]).inverse() @ RigidTransform(
        X_WC
    )
    X_PB = Transform(mounted)
    X_PB.base_frame = f"{SOAP_NAME}::body"
    config = replace(SMALL, camera=replace(SMALL.camera, X_PB=X_PB))
    world = World(soap_and_eraser(), config, estimator=Weigher())
    world.trigger(1.0)
    world.simulator.AdvanceTo(0.02)
    np.testing.assert_allclose(world.shown("observation").value.X_WC, X_WC, atol=1e-4)


def test_a_frame_that_is_not_there_is_named() -> None:
    X_PB = Transform()
    X_PB.base_frame = "arm::wrist"
    config = replace(SMALL, camera=replace(SMALL.camera, X_PB=X_PB))
    with pytest.raises(InputError, match="the plant has no frame 'arm::wrist'"):
        World({}, config)


def network(path: Path, *names: str) -> PerceptionConfig:
    """A configuration with an untrained network that knows the soap and the eraser."""
    classes = (ObjectClass(SOAP, names[0]), ObjectClass(ERASER, names[1]))
    write_weights_of(path, classes)
    return replace(SMALL, detector=NetworkDetectorConfig(str(path)))


def test_the_network_sees_the_colours_that_the_camera_gives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def detect(self: Any, color: Any, depth: Any) -> tuple[Detection, ...]:
        asked.append((color, depth))
        masks = [np.zeros(depth.shape, bool) for _ in range(4)]
        for k, mask in enumerate(masks):
            mask[20 * k : 20 * k + 20, :40] = True
        scored = ((SOAP, 0.6), (SOAP, 0.9), (ERASER, 0.3), (ERASER, 0.7))
        return tuple(
            Detection(i, np.array([0.0, 20 * k, 40, 20 * k + 20]), score, masks[k])
            for k, (i, score) in enumerate(scored)
        )

    monkeypatch.setattr(NetworkDetector, "detect", detect)
    config = network(tmp_path / "weights", SOAP_NAME, ERASER_NAME)
    world = World(soap_and_eraser(), config, estimator=Weigher())
    world.trigger(1.0)
    world.simulator.AdvanceTo(0.02)
    ((color, depth),) = asked
    seen = world.shown("observation").value
    np.testing.assert_array_equal(color, seen.color)
    np.testing.assert_array_equal(depth, seen.depth)
    assert color.std() > 5
    found = world.shown("detections").value
    assert [(d.object_id, d.score) for d in found] == [(SOAP, 0.9), (ERASER, 0.7)]


def test_a_network_that_does_not_know_the_objects_of_the_plant_is_named(
    tmp_path: Path,
) -> None:
    config = network(tmp_path / "weights", SOAP_NAME, "teapot")
    with pytest.raises(InputError, match=rf"is {ERASER_NAME}, here it is teapot"):
        World(soap_and_eraser(), config)
    World({SOAP_NAME: soap_and_eraser()[SOAP_NAME]}, config, estimator=Weigher())


def test_a_plant_must_be_finalized() -> None:
    builder = DiagramBuilder()
    AddMultibodyPlantSceneGraph(builder, 0.0)
    with pytest.raises(InputError, match="plant: is not finalized"):
        AddPerceptionDiagram(builder, SMALL)


def test_what_has_another_name_is_told() -> None:
    builder = DiagramBuilder()
    add_table(
        builder,
        {"object_0": soap_and_eraser()[SOAP_NAME], ERASER_NAME: np.eye(4)},
        {"object_0": SOAP_NAME},
    )
    perception = AddPerceptionDiagram(
        builder,
        replace(SMALL, objects={"object_0": SOAP_NAME}),
        library=two_objects(),
        estimator=Weigher(),  # type: ignore[arg-type]
    )
    names = {i.name: i.object_id for i in perception.instances}
    assert names == {"object_0": SOAP, ERASER_NAME: ERASER}


def test_principal_axes_need_no_hypotheses() -> None:
    config = replace(SMALL, estimator=EstimatorConfig(Method.PCA_ICP))
    world = World(soap_and_eraser(), config)
    assert not world.perception.HasOutputPort("hypotheses")
    world.trigger(1.0)
    world.simulator.AdvanceTo(0.03)
    estimate = world.shown("scene_estimate").value
    assert [o.found for o in estimate.objects] == [True, True]


def test_estimates_are_shown_in_meshcat() -> None:
    meshcat = Meshcat()
    world = World(soap_and_eraser(), estimator=Weigher(), meshcat=meshcat)
    world.trigger(1.0)
    world.simulator.AdvanceTo(0.03)
    assert meshcat.HasPath("/perception/cloud")
    assert meshcat.HasPath("/perception/estimate")


def test_meshcat_is_started_where_it_is_asked_for() -> None:
    world = World({}, replace(SMALL, visualize=True), estimator=Weigher())
    assert world.diagram.HasSubsystemNamed("meshcat_visualizer(visualizer)")
    assert world.perception.HasSubsystemNamed("pose_visualizer")


def test_worker_processes_end_with_the_diagram() -> None:
    config = replace(SMALL, estimator=replace(SMALL.estimator, workers=2))
    world = World({}, config)
    workers = multiprocessing.active_children()
    assert len(workers) == 2
    with world.perception as perception:
        assert isinstance(perception, PerceptionDiagram)
    assert not any(worker.is_alive() for worker in workers)
    world.perception.close()  # again, to no effect


def test_an_estimator_that_was_given_stays_open() -> None:
    closed = []

    class Kept(Weigher):
        def close(self) -> None:
            closed.append(1)

    World({}, estimator=Kept()).perception.close()
    assert closed == []
