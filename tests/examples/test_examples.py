# SPDX-License-Identifier: MIT
from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from physim_drake.datasets.bop import BopDataset
from physim_drake.estimation.estimator import EstimationConfig, Method
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary

FOLDER = Path(__file__).parents[2] / "examples"


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_estimate_scene_writes_overlay_and_directives(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = EstimationConfig(Method.PCA_ICP)
    load("estimate_scene").main(out=tmp_path, config=config)
    assert "kleenex_tissue_box: xyz" in capsys.readouterr().out
    assert (tmp_path / "overlay.png").stat().st_size > 10_000
    assert (tmp_path / "scene" / "scene.dmd.yaml").is_file()


def test_an_estimate_is_compared_with_the_truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    example = load("compare_with_truth")
    config = EstimationConfig(Method.SUPER4PCS_ICP)
    monkeypatch.setattr(example, "EstimationConfig", lambda **_: config)
    arguments = ["compare_with_truth.py", "--out", str(tmp_path / "o")]
    monkeypatch.setattr(sys, "argv", arguments)
    example.main()
    printed = capsys.readouterr().out
    assert "off by mm" in printed
    row = next(line for line in printed.splitlines() if "up_glucose_bottle" in line)
    assert float(row.split()[-2]) < 10.0
    assert str(tmp_path / "o" / "overlay.png") in printed
    assert (tmp_path / "o" / "overlay.png").is_file()


def test_the_example_scene_is_small_and_consistent() -> None:
    root = FOLDER / "data" / "tabletop"
    files = [path for path in root.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 1_500_000
    dataset = BopDataset(root)
    observation = dataset.observation(1, 0)
    assert observation.color is not None
    assert observation.X_WC is not None
    truth = dataset.ground_truth(1, 0)
    assert sorted(pose.level or 0 for pose in truth) == [1, 1, 2]
    library = ObjectLibrary.load(APC11, {pose.object_id for pose in truth})
    for pose in truth:
        X_WO = observation.X_WC @ pose.X_CO
        p_WV = np.asarray(library[pose.object_id].mesh.vertices) @ X_WO[:3, :3].T
        lowest = (p_WV + X_WO[:3, 3])[:, 2].min()
        support = 0.110 if pose.level == 2 else 0.0
        assert abs(lowest - support) < 0.001


@pytest.mark.parametrize("index", [0, 1, 2])
def test_masks_of_the_example_scene_cover_their_object(index: int) -> None:
    dataset = BopDataset(FOLDER / "data" / "tabletop")
    observation = dataset.observation(1, 0)
    pose, detection = dataset.ground_truth(1, 0)[index], dataset.masks(1, 0)[index]
    library = ObjectLibrary.load(APC11, {pose.object_id})
    points, _ = library[pose.object_id].surface_sample(2000)
    uv = observation.intrinsics.project(points @ pose.X_CO[:3, :3].T + pose.X_CO[:3, 3])
    left, top, right, bottom = detection.box
    inside = (uv >= [left - 1, top - 1]) & (uv <= [right + 1, bottom + 1])
    assert inside.all(axis=1).mean() > 0.95
