# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import torch
from typer.testing import CliRunner, Result

import physim_drake.self_learning.exploration as exploration
from physim_drake.cli import app
from physim_drake.detection.networks.factory import classes_of
from physim_drake.errors import InputError
from physim_drake.self_learning.labels import LabelledScene
from physim_drake.sensors.presets import CameraName
from tests.cli.test_detect import write_weights, write_weights_of
from tests.synthetic import library


class QuietExplorer:
    """Stands for the robot. It is told what to look with, and is never sure."""

    made: list[Any]

    def __init__(self, scenario: Any, conditions: Any, config: Any) -> None:
        self.library = library()
        QuietExplorer.made = [scenario, conditions, config]

    def __enter__(self) -> QuietExplorer:
        return self

    def __exit__(self, *error: object) -> None: ...

    def explore(self, number: int, detector: Any) -> LabelledScene:
        assert detector.detect
        return LabelledScene((), (), 0, 0)


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, ["learn", *map(str, arguments)])


def problem(result: Result) -> str:
    assert isinstance(result.exception, InputError), result.output
    return str(result.exception)


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    return write_weights_of(tmp_path / "weights.safetensors", classes_of(library()))


def test_the_options_reach_the_robot(
    weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(exploration, "Explorer", QuietExplorer)
    conditions = tmp_path / "conditions.yaml"
    conditions.write_text("camera: sr300\nrenderer: {cast_shadows: true}\n")
    out = tmp_path / "out"
    result = run(
        out, "--weights", weights, "--conditions", conditions, "--scenes", "3",
        "--views", "2", "--workers", "1", "--seed", "7", "--quiet",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "0 images with 0 labels" in result.output
    scenario, how, config = QuietExplorer.made
    assert (config.views, config.workers, config.seed) == (2, 1, 7)
    assert how.camera is CameraName.SR300
    assert how.renderer.cast_shadows
    assert len(how.renderer.lights) == 2  # the cell's, where the file says nothing
    assert Path(scenario.objects.library).is_dir()
    assert len(json.loads((out / "learning.json").read_text())["scenes"]) == 3


def test_an_unknown_key_of_the_conditions(weights: Path, tmp_path: Path):
    path = tmp_path / "conditions.yaml"
    path.write_text("lamp: 3\n")
    result = run(tmp_path / "out", "--weights", weights, "--conditions", path)
    assert "lamp" in problem(result)


def test_weights_for_other_objects(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(exploration, "Explorer", QuietExplorer)
    other = write_weights(tmp_path / "other.safetensors", 1, 99)
    result = run(tmp_path / "out", "--weights", other)
    assert "are weights for other objects" in problem(result)


def test_a_pickle_is_never_loaded(tmp_path: Path):
    torch.save({}, tmp_path / "weights.pt")
    result = run(tmp_path / "out", "--weights", tmp_path / "weights.pt")
    assert "pickles are never loaded" in problem(result)
    assert not (tmp_path / "out").exists()
