# SPDX-License-Identifier: MIT
"""Drake systems over the algorithms of physim_drake."""

from __future__ import annotations

from physim_drake.observation.detector import DetectionAlgorithm
from physim_drake.systems.camera_source import CameraSource, CameraSourceConfig
from physim_drake.systems.detector import (
    Detector,
    DetectorConfig,
    OracleDetector,
    TrainedDetector,
)
from physim_drake.systems.ground_truth import GroundTruthPoses
from physim_drake.systems.hypothesis_generator import (
    HypothesisGenerator,
    SceneHypotheses,
)
from physim_drake.systems.object_instances import (
    ObjectInstance,
    find_object_instances,
)
from physim_drake.systems.perception import AddPerceptionDiagram, PerceptionDiagram
from physim_drake.systems.perception_config import (
    EstimatorConfig,
    LatencyConfig,
    NetworkDetectorConfig,
    OracleDetectorConfig,
    PerceptionCameraConfig,
    PerceptionConfig,
)
from physim_drake.systems.pose_error_monitor import LookErrors, PoseErrorMonitor
from physim_drake.systems.pose_estimator import SceneEstimator
from physim_drake.systems.pose_visualizer import PoseVisualizer, PoseVisualizerConfig
from physim_drake.systems.replay_source import ReplaySource, ReplaySourceConfig
from physim_drake.systems.source import Source
from physim_drake.systems.stage import Look, Stage, Stamped, TimingConfig

MctsPoseEstimator = SceneEstimator
"""The old name of `SceneEstimator`, which runs every method, not the search alone."""

__all__ = [
    "AddPerceptionDiagram",
    "CameraSource",
    "CameraSourceConfig",
    "DetectionAlgorithm",
    "Detector",
    "DetectorConfig",
    "EstimatorConfig",
    "GroundTruthPoses",
    "HypothesisGenerator",
    "LatencyConfig",
    "Look",
    "LookErrors",
    "MctsPoseEstimator",
    "NetworkDetectorConfig",
    "ObjectInstance",
    "OracleDetector",
    "OracleDetectorConfig",
    "PerceptionCameraConfig",
    "PerceptionConfig",
    "PerceptionDiagram",
    "PoseErrorMonitor",
    "PoseVisualizer",
    "PoseVisualizerConfig",
    "ReplaySource",
    "ReplaySourceConfig",
    "SceneEstimator",
    "SceneHypotheses",
    "Source",
    "Stage",
    "Stamped",
    "TimingConfig",
    "TrainedDetector",
    "find_object_instances",
]
