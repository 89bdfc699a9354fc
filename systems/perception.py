# SPDX-License-Identifier: MIT
"""All of perception as one Diagram: camera, detector, hypotheses, search, judge."""

from __future__ import annotations

import weakref
from collections import Counter
from dataclasses import replace
from typing import Any

from pydrake.geometry import (
    Meshcat,
    MeshcatParams,
    MeshcatVisualizer,
    SceneGraph,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder

from physim_drake.closing import Closing
from physim_drake.errors import InputError
from physim_drake.estimation.estimator import Method, PoseEstimator
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.detector import DetectionAlgorithm
from physim_drake.systems.camera_source import CameraSource
from physim_drake.systems.detector import (
    Detector,
    DetectorConfig,
)
from physim_drake.systems.ground_truth import GroundTruthPoses
from physim_drake.systems.hypothesis_generator import HypothesisGenerator
from physim_drake.systems.object_instances import find_object_instances
from physim_drake.systems.perception_config import (
    OracleDetectorConfig,
    PerceptionConfig,
)
from physim_drake.systems.pose_error_monitor import PoseErrorMonitor
from physim_drake.systems.pose_estimator import SceneEstimator
from physim_drake.systems.pose_visualizer import PoseVisualizer
from physim_drake.systems.rgbd_sensors import add_rgbd_sensors
from physim_drake.systems.stage import TimingConfig


class PerceptionDiagram(Diagram, Closing):
    """Estimates the poses of a plant's objects whenever it is triggered.

    .. pydrake_system::

        name: PerceptionDiagram
        input_ports:
        - query_object
        - body_poses
        - trigger (optional with a period)
        output_ports:
        - observation
        - labels
        - detections
        - hypotheses (not with pca-icp and fcn-pca-icp, which make none)
        - scene_estimate
        - true_poses
        - look_poses
        - pose_errors

    The ports are those of the systems inside: `CameraSource`, `Detector`,
    `HypothesisGenerator`, `SceneEstimator`, `GroundTruthPoses`, `PoseErrorMonitor`.
    ``query_object`` is the scene graph's, ``body_poses`` the plant's;
    `AddPerceptionDiagram` connects both.

    The estimator may have worker processes. They end with `close`, at the end of a
    ``with`` block, or with the interpreter.

    Args:
        plant: the plant that the objects are in; finalized.
        scene_graph: geometry of the plant; gets the camera's renderers.
        config: all settings.
        library: the objects.
        detector: replaces that of `config`.
        estimator: replaces that of `config`; whoever made it closes it.
        meshcat: shows the estimates; may be None.

    Attributes:
        library: the objects.
        instances: which of them the plant has.
        estimator: shared by the generator of hypotheses and the search.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        config: PerceptionConfig,
        library: ObjectLibrary,
        detector: DetectionAlgorithm | None = None,
        estimator: PoseEstimator | None = None,
        meshcat: Meshcat | None = None,
    ) -> None:
        super().__init__()
        self.library, self._config = library, config
        self.instances = find_object_instances(plant, library, config.objects)
        builder = DiagramBuilder()
        camera = self._add_camera(builder, plant, scene_graph)
        detections = self._add_detector(builder, camera, detector)
        self.estimator = estimator or PoseEstimator(
            library, config.estimator.estimation
        )
        if estimator is None:
            self._end = weakref.finalize(self, self.estimator.close)
        estimate = self._add_estimator(builder, camera, detections)
        self._add_judge(builder, estimate)
        if meshcat is not None:
            self._add_visualizer(builder, camera, estimate, meshcat)
        builder.BuildInto(self)

    def close(self) -> None:
        """Ends the worker processes, unless the estimator was given."""
        if hasattr(self, "_end"):
            self._end()

    def _timing(self, latency: float = 0.0) -> TimingConfig:
        return TimingConfig(latency, self._config.poll_period)

    def _add_camera(
        self, builder: DiagramBuilder, plant: MultibodyPlant, scene_graph: SceneGraph
    ) -> CameraSource:
        config = self._config
        sensor, echo = add_rgbd_sensors(builder, plant, scene_graph, config.camera)
        camera = CameraSource(
            config.camera.intrinsics,
            config.camera,
            config.period,
            self._timing(config.latency.camera),
        )
        builder.AddNamedSystem("camera", camera)
        for name in ("color_image", "depth_image_32f", "label_image"):
            builder.Connect(sensor.GetOutputPort(name), camera.GetInputPort(name))
        builder.Connect(
            sensor.body_pose_in_world_output_port(), camera.GetInputPort("X_WC")
        )
        builder.ExportInput(sensor.query_object_input_port(), "query_object")
        if echo is not None:
            builder.ConnectInput("query_object", echo.query_object_input_port())
            builder.Connect(
                echo.color_image_output_port(), camera.GetInputPort("echo_image")
            )
        builder.ExportInput(camera.GetInputPort("trigger"), "trigger")
        _export(builder, camera, "observation", "labels")
        return camera

    def _add_detector(
        self,
        builder: DiagramBuilder,
        camera: CameraSource,
        algorithm: DetectionAlgorithm | None,
    ) -> Detector:
        config, seed = self._config, 0
        if isinstance(config.detector, OracleDetectorConfig):
            seed = config.detector.seed
        detector = Detector(
            self._make_detector() if algorithm is None else algorithm,
            DetectorConfig(seed, self._timing(config.latency.detector)),
        )
        builder.AddNamedSystem("detector", detector)
        _connect(builder, camera, detector, "observation", "labels")
        _export(builder, detector, "detections")
        return detector

    def _make_detector(self) -> DetectionAlgorithm:
        """The detector that is configured, for the objects that the plant has."""
        config = self._config.detector
        if isinstance(config, OracleDetectorConfig):
            return config.make(self.instances)
        if self._config.estimator.method is Method.FCN_PCA_ICP:
            config = replace(config, pixels=True)
        counts = Counter(i.object_id for i in self.instances)
        return config.make({i: self.library[i] for i in counts}, counts)

    def _add_estimator(
        self, builder: DiagramBuilder, camera: CameraSource, detector: Detector
    ) -> SceneEstimator:
        config, latency = self._config.estimator, self._config.latency
        estimator = SceneEstimator(
            self.estimator, config.surface_height, self._timing(latency.estimator)
        )
        builder.AddNamedSystem("pose_estimator", estimator)
        _connect(builder, camera, estimator, "observation")
        _connect(builder, detector, estimator, "detections")
        if config.method.makes_hypotheses:
            generator = HypothesisGenerator(
                self.estimator, config.surface_height, self._timing(latency.hypotheses)
            )
            builder.AddNamedSystem("hypothesis_generator", generator)
            _connect(builder, camera, generator, "observation")
            _connect(builder, detector, generator, "detections")
            _connect(builder, generator, estimator, "hypotheses")
            _export(builder, generator, "hypotheses")
        _export(builder, estimator, "scene_estimate")
        return estimator

    def _add_judge(self, builder: DiagramBuilder, estimator: SceneEstimator) -> None:
        truth = GroundTruthPoses(self.instances, self._config.period, self._timing())
        builder.AddNamedSystem("ground_truth", truth)
        builder.ConnectInput("trigger", truth.GetInputPort("trigger"))
        builder.ExportInput(truth.GetInputPort("body_poses"), "body_poses")
        monitor = PoseErrorMonitor(self.library, self.instances, self._timing())
        builder.AddNamedSystem("pose_error_monitor", monitor)
        _connect(builder, estimator, monitor, "scene_estimate")
        _connect(builder, truth, monitor, "look_poses")
        _export(builder, truth, "true_poses", "look_poses")
        _export(builder, monitor, "pose_errors")

    def _add_visualizer(
        self,
        builder: DiagramBuilder,
        camera: CameraSource,
        estimator: SceneEstimator,
        meshcat: Meshcat,
    ) -> None:
        visualizer = PoseVisualizer(
            meshcat, self.library, self._config.visualizer, self._timing()
        )
        builder.AddNamedSystem("pose_visualizer", visualizer)
        _connect(builder, camera, visualizer, "observation")
        _connect(builder, estimator, visualizer, "scene_estimate")


def AddPerceptionDiagram(
    builder: DiagramBuilder,
    config: PerceptionConfig = PerceptionConfig(),  # noqa: B008 (frozen)
    scene_graph: SceneGraph | None = None,
    *,
    plant: MultibodyPlant | None = None,
    library: ObjectLibrary | None = None,
    detector: DetectionAlgorithm | None = None,
    estimator: PoseEstimator | None = None,
    meshcat: Meshcat | None = None,
    name: str = "perception",
) -> PerceptionDiagram:
    """Adds perception of a plant's objects to a diagram.

    Connect, or fix, the port ``trigger`` of what is returned, unless the configuration
    has a period, and close it at the end.

    Args:
        builder: builder of the diagram; has a finalized plant and its scene graph.
        config: all settings.
        scene_graph: the system named "scene_graph" if it is None.
        plant: the system named "plant" if it is None.
        library: replaces that of `config`.
        detector: replaces that of `config`; see `DetectionAlgorithm`.
        estimator: replaces that of `config`; whoever made it closes it.
        meshcat: shows the estimates; if it is None and `config` asks for it, one is
            started that also shows the true scene.
        name: name of the perception diagram.

    Raises:
        InputError: if the plant has no camera frame or object of the names in
            `config`, or the library cannot be used, or the detector's weights cannot
            be used or are for other objects.
    """
    graph: Any = scene_graph or builder.GetSubsystemByName("scene_graph")
    world: Any = plant or builder.GetSubsystemByName("plant")
    if not world.is_finalized():
        raise InputError("plant", "is not finalized", "call plant.Finalize() before")
    if meshcat is None and config.visualize:
        meshcat = Meshcat(MeshcatParams(host="localhost"))
        MeshcatVisualizer.AddToBuilder(builder, graph, meshcat)
    perception: Any = PerceptionDiagram(
        world,
        graph,
        config,
        library or config.load_library(),
        detector,
        estimator,
        meshcat,
    )
    builder.AddNamedSystem(name, perception)
    builder.Connect(
        graph.get_query_output_port(), perception.GetInputPort("query_object")
    )
    builder.Connect(
        world.get_body_poses_output_port(), perception.GetInputPort("body_poses")
    )
    return perception  # type: ignore[no-any-return]


def _connect(builder: DiagramBuilder, source: Any, target: Any, *ports: str) -> None:
    for port in ports:
        builder.Connect(source.GetOutputPort(port), target.GetInputPort(port))


def _export(builder: DiagramBuilder, system: Any, *ports: str) -> None:
    for port in ports:
        builder.ExportOutput(system.GetOutputPort(port), port)
