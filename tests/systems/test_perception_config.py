# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.parsing import ModelDirective
from pydrake.systems.sensors import CameraConfig

from physim_drake.errors import InputError
from physim_drake.estimation.estimator import EstimationConfig, Method
from physim_drake.sensors.presets import CameraName
from physim_drake.storage.typed_yaml import load_typed_yaml
from physim_drake.systems.perception_config import (
    EstimatorConfig,
    NetworkDetectorConfig,
    OracleDetectorConfig,
    PerceptionConfig,
)

ONE_OF_EVERYTHING = """
camera:
  preset: sr300
  width: 320
  height: 240
  depth_noise: true
  color_noise: false
  reflections: false
  seed: 5
  X_PB:
    base_frame: arm::wrist
    translation: [0.0, 0.1, 0.2]
    rotation: !Rpy {deg: [0.0, 0.0, 90.0]}
  renderer: mine
detector: !OracleDetectorConfig {jitter: 0.1, min_pixels: 50, seed: 6}
estimator:
  method: physim-heuristic
  expansions: 100
  representatives: 20
  rounds: 1
  workers: 3
  seed: 7
  surface_height: 0.72
  least_confidence: 0.3
latency: {camera: 0.03, detector: 0.2, hypotheses: 1.0, estimator: 4.0}
period: 2.0
poll_period: 0.01
library: models
objects: {object_0: dove_beauty_bar}
visualize: true
visualizer:
  {path: /seen, opacity: 0.3, cloud: false, cloud_stride: 3, point_size: 0.001}
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "perception.yaml"
    path.write_text(text)
    return path


def test_one_of_everything(tmp_path: Path) -> None:
    config = PerceptionConfig.load(written(tmp_path, ONE_OF_EVERYTHING))
    camera = config.camera
    assert camera.preset is CameraName.SR300
    assert (camera.intrinsics.width, camera.intrinsics.fx) == (320, 307.0)
    assert camera.noise.baseline == 0.047
    assert (camera.noise.dark_loss, camera.color_noise, camera.seed) == (0, False, 5)
    assert camera.X_PB.base_frame == "arm::wrist"
    X_PB = camera.X_PB.GetDeterministicValue()
    np.testing.assert_allclose(X_PB.translation(), [0.0, 0.1, 0.2])
    assert camera.renderer == "mine"
    detector = config.detector
    assert isinstance(detector, OracleDetectorConfig)
    assert (detector.jitter, detector.min_pixels, detector.seed) == (0.1, 50, 6)
    estimation = config.estimator.estimation
    assert estimation.method is Method.PHYSIM_HEURISTIC
    assert (estimation.workers, estimation.seed, estimation.rounds) == (3, 7, 1)
    assert estimation.search.expansions == 100
    assert estimation.steps.hypotheses.clustering.representatives == 20
    assert estimation.required_confidence == 0.3
    assert config.estimator.surface_height == 0.72
    assert config.latency.estimator == 4.0
    assert (config.period, config.poll_period) == (2.0, 0.01)
    assert config.library == str(tmp_path / "models")
    assert config.objects == {"object_0": "dove_beauty_bar"}
    assert config.visualize
    assert (config.visualizer.path, config.visualizer.cloud_stride) == ("/seen", 3)


def test_nothing_said_is_the_defaults(tmp_path: Path) -> None:
    config = PerceptionConfig.load(written(tmp_path, ""))
    assert config.estimator == EstimatorConfig()
    assert config.estimator.estimation == EstimationConfig()
    assert config.detector == NetworkDetectorConfig()
    assert config.library == "apc11"
    assert len(config.load_library()) == 11


def test_weights_are_found_beside_the_file(tmp_path: Path) -> None:
    text = "detector: {weights: own.safetensors, least_score: 0.3}"
    detector = PerceptionConfig.load(written(tmp_path, text)).detector
    assert detector == NetworkDetectorConfig(str(tmp_path / "own.safetensors"), 0.3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("camera: {prest: d415}", "prest"),
        ("camera: {preset: d999}", "'d999' is not one of d415, d435, sr300"),
        ("camera: {width: 0}", "camera: width: is 0; give pixels"),
        ("detector: !Oracle {}", "tag value 'Oracle' did not match"),
        ("detector: {jitter: 0.1}", r"\['jitter'\] were unknown"),
        ("estimator: {method: magic}", "'magic' is not one of physim-mcts"),
        ("estimator: {workers: 0}", "estimator: workers: is 0"),
    ],
)
def test_what_cannot_be_is_named_with_its_file(
    text: str, message: str, tmp_path: Path
) -> None:
    path = written(tmp_path, text)
    with pytest.raises(InputError, match=message) as caught:
        PerceptionConfig.load(path)
    assert str(caught.value).startswith(str(path))


def test_a_library_that_is_not_there_is_named(tmp_path: Path) -> None:
    config = PerceptionConfig.load(written(tmp_path, "library: none"))
    with pytest.raises(InputError, match=str(tmp_path / "none")):
        config.load_library()


@dataclass
class Station:
    """A user's own configuration."""

    cameras: dict[str, CameraConfig] = field(default_factory=dict)
    directives: list[ModelDirective] = field(default_factory=list)
    perception: PerceptionConfig = field(default_factory=PerceptionConfig)


def test_a_perception_config_stands_beside_drakes_schemas(tmp_path: Path) -> None:
    path = tmp_path / "station.yaml"
    path.write_text("""
cameras: {wrist: {width: 320}}
directives: [{add_model: {name: table, file: package://cell/table.sdf}}]
perception: {camera: {preset: d435}, detector: !OracleDetectorConfig {jitter: 0.1}}
""")
    station = load_typed_yaml(path, Station)
    assert station.cameras["wrist"].width == 320
    added = station.directives[0].add_model
    assert added is not None
    assert added.name == "table"
    assert station.perception.camera.preset is CameraName.D435
    assert station.perception.detector == OracleDetectorConfig(jitter=0.1)
