# SPDX-License-Identifier: MIT
"""Where the objects are, as a network says or given weights do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from physim_drake.batch import detection_source as batch
from physim_drake.datasets.bop import BopDataset
from physim_drake.datasets.results import read_results
from physim_drake.detection.detector import NetworkDetector
from physim_drake.detection.networks.factory import ObjectClass, classes_of
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.observation import Detection
from tests.cli.estimating import (
    BOTTLE,
    SCENE,
    Run,
    edit,
    quick,
)
from tests.cli.test_detect import write_weights, write_weights_of


def use_weights(monkeypatch: pytest.MonkeyPatch, detector: Path) -> None:
    """Makes these the weights that come with the package."""
    monkeypatch.setattr(batch, "DETECTOR", detector)


def test_without_detections_and_weights_one_of_them_is_asked_for(
    run: Run,
    dataset: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (dataset / "detections.json").unlink()
    use_weights(monkeypatch, tmp_path / "none")
    assert run(dataset, "--out", tmp_path / "r.csv", "--models", APC11) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "give --detections FILE" in line


def objects_of_apc11() -> tuple[ObjectClass, ...]:
    return classes_of(ObjectLibrary.load(APC11))


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    """Of a network that knows the package's objects by name only."""
    return write_weights_of(tmp_path / "own.safetensors", objects_of_apc11())


def masked(dataset: Path, *object_ids: int) -> Callable[..., tuple[Detection, ...]]:
    """What a network that sees these objects as they are says of the example."""
    true = [d for d in BopDataset(dataset).masks(1, 0) if d.object_id in object_ids]

    def detect(*arguments: object) -> tuple[Detection, ...]:
        return tuple(replace(d, score=0.9) for d in true)

    return detect


def test_without_detections_the_network_of_the_package_finds_the_objects(
    run: Run,
    dataset: Path,
    weights: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (dataset / "detections.json").unlink()
    use_weights(monkeypatch, weights)
    seen = masked(SCENE, *(c.object_id for c in objects_of_apc11()))
    monkeypatch.setattr(NetworkDetector, "detect", seen)
    out, traces = tmp_path / "r.csv", tmp_path / "traces"
    assert run(*quick(dataset, out), "--images", "1/0", "--trace", traces) == 0
    assert "1 of 1 object found" in capsys.readouterr().err
    assert [row.object_id for row in read_results(out)] == [BOTTLE]


def test_an_object_that_the_network_does_not_see_is_not_found(
    run: Run,
    dataset: Path,
    weights: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def two_bottles(targets: list[dict[str, Any]]) -> list[dict[str, Any]]:
        return [target | {"inst_count": 2} for target in targets]

    edit(dataset / "test_targets_bop19.json", two_bottles)
    monkeypatch.setattr(NetworkDetector, "detect", masked(SCENE, BOTTLE))
    out = tmp_path / "r.csv"
    one = ("--images", "1/0", "--weights", weights)
    assert run(*quick(dataset, out), *one) == 0
    said = capsys.readouterr().err
    assert "1/0 up_glucose_bottle: not found: the detector did not see it" in said
    assert "1 of 2 objects found" in said
    assert len(read_results(out)) == 1
    monkeypatch.setattr(NetworkDetector, "detect", masked(SCENE, 1))
    assert run(*quick(dataset, out), *one) == 0
    assert "0 of 2 objects found" in capsys.readouterr().err
    assert read_results(out) == []


def test_the_method_with_segments_of_its_own_leaves_given_boxes_alone(
    run: Run,
    dataset: Path,
    weights: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    use_weights(monkeypatch, weights)
    monkeypatch.setattr(NetworkDetector, "detect", masked(SCENE, 1))
    out = tmp_path / "r.csv"
    method = ("--method", "fcn-pca-icp", "--images", "1/0")
    assert run(*quick(dataset, out), *method) == 0
    assert "not found: the detector did not see it" in capsys.readouterr().err
    monkeypatch.setattr(NetworkDetector, "detect", masked(SCENE, BOTTLE))
    assert run(*quick(dataset, out), *method) == 0
    assert [row.object_id for row in read_results(out)] == [BOTTLE]


def damaged_weights(weights: Path, defect: str) -> Path:
    """Weights that cannot be used."""
    if defect == "of other objects":
        return write_weights(weights.with_name("other"), 1, 99)
    path = weights.with_name("bad")
    if defect == "a pickle":
        torch.save({}, path)
    elif defect == "cut short":
        path.write_bytes(weights.read_bytes()[:-9])
    return path


BAD_WEIGHTS = {
    "of other objects": "are weights for other objects",
    "a pickle": "pickles are never loaded",
    "cut short": "is damaged or not a safetensors file",
    "missing": "cannot be read: No such file",
}


@pytest.mark.parametrize("defect", BAD_WEIGHTS)
@pytest.mark.parametrize("method", ["pca-icp", "fcn-pca-icp"])
def test_weights_that_cannot_be_used_leave_earlier_results(
    run: Run,
    dataset: Path,
    weights: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    defect: str,
    method: str,
) -> None:
    out = tmp_path / "r.csv"
    out.write_text("earlier")
    bad = damaged_weights(weights, defect)
    arguments = ("--models", APC11, "--method", method, "--weights", bad)
    assert run(dataset, "--out", out, *arguments) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith(f"error: {bad}: ")
    assert captured.err.count("\n") == 1
    assert BAD_WEIGHTS[defect] in captured.err
    assert out.read_text() == "earlier"
