# SPDX-License-Identifier: MIT
"""Everything that can be set about a perception diagram, from YAML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from pydrake.common.schema import Transform

from physim_drake.estimation.config import EstimationConfig
from physim_drake.estimation.method_config import MethodConfig
from physim_drake.extras import need_extra
from physim_drake.models import APC11, DETECTOR
from physim_drake.objects.model import ObjectLibrary, ObjectModel
from physim_drake.observation.detection_selection import ChoiceConfig
from physim_drake.sensors.presets import CameraName
from physim_drake.storage.typed_yaml import load_typed_yaml
from physim_drake.systems.camera_source import CameraSourceConfig
from physim_drake.systems.detector import OracleDetector, TrainedDetector
from physim_drake.systems.object_instances import ObjectInstance
from physim_drake.systems.pose_visualizer import PoseVisualizerConfig

LIBRARIES = {"apc11": APC11}
"""The object libraries that come with the package, by name."""


@dataclass(frozen=True)
class PerceptionCameraConfig(CameraSourceConfig):
    """A camera and its pose.

    Attributes:
        X_PB: pose of the optical frame (z forward, x right, y down) in the frame of
            the plant that its ``base_frame`` names, as in ``arm::wrist``; by default
            the world.
        renderer: name of a renderer of the scene graph; it is made if it is missing.
    """

    X_PB: Transform = field(default_factory=Transform)
    renderer: str = "perception"

    @classmethod
    def at_frame(
        cls,
        frame: str,
        preset: CameraName,
        noise: bool,
        seed: int,
        renderer: str = "perception",
    ) -> PerceptionCameraConfig:
        """A camera whose optical frame is one of the plant's.

        Args:
            frame: name of the frame, as in ``arm::wrist``.
            preset: name of the camera.
            noise: whether depth and colour err and reflections cost depth.
            seed: seed of all errors.
            renderer: name of the renderer in the scene graph.
        """
        return cls(
            preset=preset,
            depth_noise=noise,
            color_noise=noise,
            reflections=noise,
            seed=seed,
            X_PB=Transform(base_frame=frame),
            renderer=renderer,
        )


@dataclass(frozen=True)
class NetworkDetectorConfig:
    """A network that was trained to find the objects; see `TrainedDetector`.

    Attributes:
        weights: file that physim-drake train wrote, relative to the file of this
            configuration; if it is empty, the weights that come with the package,
            which know the objects of apc11.
        least_score: score below which a detection is dropped, 0..1.
        min_pixels: number of pixels that an object must show to be detected.
        pixels: use only what tells the class of every pixel; each object is then
            detected at most once.
    """

    weights: str = ""
    least_score: float = 0.5
    min_pixels: int = 100
    pixels: bool = False

    def make(
        self, objects: Mapping[int, ObjectModel], counts: Mapping[int, int]
    ) -> TrainedDetector:
        """The detector of these objects.

        Args:
            objects: objects to find, by id.
            counts: greatest number of each.

        Raises:
            InputError: if the weights cannot be used, or are for other objects.
        """
        need_extra("train")
        # Imported here, since torch takes its time.
        from physim_drake.detection.detector import NetworkDetector

        path = Path(self.weights) if self.weights else DETECTOR
        network = NetworkDetector.load(path, pixels=self.pixels)
        names = {object_id: model.name for object_id, model in objects.items()}
        network.check_objects(names, "the library")
        config = ChoiceConfig(self.least_score, self.min_pixels)
        return TrainedDetector(network, counts, config)


@dataclass(frozen=True)
class OracleDetectorConfig:
    """A detector that knows where the objects are; see `OracleDetector`.

    Attributes:
        jitter: share of a box's size that each side is off by at most.
        min_pixels: number of pixels that an object must show to be detected.
        seed: seed of the jitter.
    """

    jitter: float = 0.06
    min_pixels: int = 100
    seed: int = 0

    def make(self, instances: Sequence[ObjectInstance]) -> OracleDetector:
        """The detector of these objects."""
        return OracleDetector(instances, self.jitter, self.min_pixels)


@dataclass(frozen=True)
class EstimatorConfig(MethodConfig):
    """How poses are estimated; see `MethodConfig` for the method and its effort.

    Attributes:
        rounds: greatest number of searches of a group.
        seed: seed of all random choices.
        surface_height: z of the support surface in the world, m; None if it is to be
            found in each image.
        least_confidence: confidence below which an object is not found, 0..1; None
            for the method's own limit.
    """

    rounds: int = 3
    seed: int = 0
    surface_height: float | None = None
    least_confidence: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_positive("rounds")

    @property
    def estimation(self) -> EstimationConfig:
        """The same for the algorithms."""
        return self.applied_to(
            EstimationConfig(
                seed=self.seed,
                rounds=self.rounds,
                least_confidence=self.least_confidence,
            )
        )


@dataclass(frozen=True)
class LatencyConfig:
    """Simulated time that each stage takes, s."""

    camera: float = 0.0
    detector: float = 0.0
    hypotheses: float = 0.0
    estimator: float = 0.0


@dataclass(frozen=True)
class PerceptionConfig:
    """A perception diagram.

    Attributes:
        camera: camera and its pose.
        detector: used if no other detector is given to the diagram; in YAML an
            oracle is tagged, as in ``detector: !OracleDetectorConfig {jitter: 0.06}``.
        estimator: settings of the estimation.
        latency: latency of each stage.
        period: time between looks, s; None for looks by the trigger alone.
        poll_period: time between a stage's looks at its inputs, s; 0 for each step.
        library: the objects: a name of `LIBRARIES`, or a folder of models.
        objects: object's name by model instance's, if they differ; see
            `find_object_instances`.
        visualize: whether estimates are shown in Meshcat.
        visualizer: how they are shown.
    """

    camera: PerceptionCameraConfig = field(default_factory=PerceptionCameraConfig)
    detector: NetworkDetectorConfig | OracleDetectorConfig = field(
        default_factory=NetworkDetectorConfig
    )
    estimator: EstimatorConfig = field(default_factory=EstimatorConfig)
    latency: LatencyConfig = field(default_factory=LatencyConfig)
    period: float | None = None
    poll_period: float = 0.0
    library: str = "apc11"
    objects: Mapping[str, str] = field(default_factory=dict)
    visualize: bool = False
    visualizer: PoseVisualizerConfig = field(default_factory=PoseVisualizerConfig)

    @classmethod
    def load(cls, path: Path) -> PerceptionConfig:
        """Reads a YAML file. The paths in it are relative to its folder.

        Raises:
            InputError: if the file cannot be used.
        """
        config = load_typed_yaml(path, cls)
        detector = config.detector
        if isinstance(detector, NetworkDetectorConfig) and detector.weights:
            detector = replace(detector, weights=str(path.parent / detector.weights))
            config = replace(config, detector=detector)
        if config.library in LIBRARIES:
            return config
        return replace(config, library=str(path.parent / config.library))

    def load_library(self) -> ObjectLibrary:
        """Reads the objects.

        Raises:
            InputError: if they cannot be used.
        """
        return ObjectLibrary.load(LIBRARIES.get(self.library, Path(self.library)))
