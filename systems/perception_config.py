# SPDX-License-Identifier: MIT
"""Everything that can be set about a perception diagram, from YAML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from pydrake.common.schema import Transform

from physim_drake.errors import InputError
from physim_drake.estimation.estimator import EstimationConfig, Method
from physim_drake.extras import need_extra
from physim_drake.models import APC11, DETECTOR
from physim_drake.objects.model import ObjectLibrary, ObjectModel
from physim_drake.observation.detection_selection import ChoiceConfig
from physim_drake.storage.typed_yaml import load_typed_yaml
from physim_drake.systems.camera_source import CameraSourceConfig
from physim_drake.systems.detector import OracleDetector, TrainedDetector
from physim_drake.systems.object_instances import ObjectInstance
from physim_drake.systems.pose_visualizer import PoseVisualizerConfig

LIBRARIES = {"apc11": APC11}
"""The object libraries that come with the package, by name."""


@dataclass(frozen=True)
class PerceptionCameraConfig(CameraSourceConfig):
    """A camera, and where it is.

    Attributes:
        X_PB: pose of the optical frame (z forward, x right, y down) in the frame of
            the plant that its ``base_frame`` names, as in ``arm::wrist``; by default
            the world.
        renderer: of the scene graph; is made where there is none of this name.
    """

    X_PB: Transform = field(default_factory=Transform)
    renderer: str = "perception"


@dataclass(frozen=True)
class NetworkDetectorConfig:
    """A network that was trained to find the objects; see `TrainedDetector`.

    Attributes:
        weights: what physim-drake train wrote, relative to the file of this
            configuration; where it is empty, the weights that come with the package,
            which know the objects of apc11.
        least_score: less certain detections are dropped.
        min_pixels: objects that show less are not detected.
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
            objects: which ones, by id.
            counts: how many there may be of each.

        Raises:
            InputError: where the weights cannot be used, or are for other objects.
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
    """A detector that knows what is where; see `OracleDetector`.

    Attributes:
        jitter: each side of a box is off by up to this share of the box's size.
        min_pixels: objects that show less are not detected.
        seed: of the jitter.
    """

    jitter: float = 0.06
    min_pixels: int = 100
    seed: int = 0

    def make(self, instances: Sequence[ObjectInstance]) -> OracleDetector:
        """The detector of these objects."""
        return OracleDetector(instances, self.jitter, self.min_pixels)


@dataclass(frozen=True)
class EstimatorConfig:
    """How poses are estimated; see `EstimationConfig`.

    Attributes:
        method: how.
        expansions: budget of the search, per group of objects.
        representatives: hypotheses per object that the search chooses from.
        rounds: a group is searched at most this often.
        workers: processes; the result does not depend on it.
        seed: of all random choices.
        surface_height: z of the support surface in the world, m; found in each image
            where it is None.
        least_confidence: an object that the image confirms by less is not found; the
            method's own limit where it is None.
    """

    method: Method = Method.PHYSIM_MCTS
    expansions: int = 250
    representatives: int = 25
    rounds: int = 3
    workers: int = 1
    seed: int = 0
    surface_height: float | None = None
    least_confidence: float | None = None

    def __post_init__(self) -> None:
        for name in ("expansions", "representatives", "rounds", "workers"):
            if getattr(self, name) < 1:
                raise InputError(
                    "estimator",
                    f"is {getattr(self, name)}",
                    "give a positive number",
                    name,
                )

    @property
    def estimation(self) -> EstimationConfig:
        """The same for the algorithms."""
        config = EstimationConfig(
            self.method,
            self.seed,
            self.workers,
            rounds=self.rounds,
            least_confidence=self.least_confidence,
        )
        return config.with_budget(self.expansions, self.representatives)


@dataclass(frozen=True)
class LatencyConfig:
    """How long each stage is said to take, s of simulated time."""

    camera: float = 0.0
    detector: float = 0.0
    hypotheses: float = 0.0
    estimator: float = 0.0


@dataclass(frozen=True)
class PerceptionConfig:
    """A perception diagram.

    Attributes:
        camera: the camera, and where it is.
        detector: used where no other detector is given to the diagram; in YAML an
            oracle is tagged, as in ``detector: !OracleDetectorConfig {jitter: 0.06}``.
        estimator: how poses are estimated.
        latency: of the stages.
        period: of looks, s; None for looks by the trigger alone.
        poll_period: how often stages look at their inputs, s; 0 for each step.
        library: the objects: a name of `LIBRARIES`, or a folder of models.
        objects: object's name by model instance's, where they differ; see
            `find_object_instances`.
        visualize: whether estimates are shown in Meshcat.
        visualizer: how.
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
        """Reads a YAML file; the paths in it are relative to its folder.

        Raises:
            InputError: where the file cannot be used.
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
            InputError: where they cannot be used.
        """
        return ObjectLibrary.load(LIBRARIES.get(self.library, Path(self.library)))
