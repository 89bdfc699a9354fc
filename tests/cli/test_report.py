# SPDX-License-Identifier: MIT
"""The command and its choice of detections; the page is tested in tests/reporting."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from physim_drake.batch import detection_source as batch
from physim_drake.cli import main
from physim_drake.datasets.bop import BopDataset
from physim_drake.detection.detector import NetworkDetector
from physim_drake.detection.networks.factory import classes_of
from physim_drake.errors import InputError
from physim_drake.estimation.estimator import PoseEstimator
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.observation.support_surface import SupportSurface
from physim_drake.reporting.study import HypothesisQuality, Study
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from tests.cli.test_detect import write_weights_of

SCENE = Path(__file__).parents[2] / "examples" / "data" / "tabletop"
QUICK = ("--models", APC11, "--workers", 1, "--expansions", 4, "--hypotheses", 4)
BOTTLE = 5

Run = Callable[..., int | str | None]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Run:
    """Runs `physim-drake report` on the example and gives its exit status."""

    def call(*arguments: object) -> int | str | None:
        options = map(str, (SCENE, "--out", tmp_path / "out", *QUICK, *arguments))
        monkeypatch.setattr(sys, "argv", ["physim-drake", "report", *options])
        with pytest.raises(SystemExit) as caught:
            main()
        return caught.value.code

    return call


@pytest.fixture
def weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Of a network that sees what is there, but for the bottle."""
    true = [d for d in BopDataset(SCENE).masks(1, 0) if d.object_id != BOTTLE]

    def detect(*arguments: object) -> tuple[Detection, ...]:
        return tuple(replace(d, score=0.9) for d in true)

    monkeypatch.setattr(NetworkDetector, "detect", detect)
    classes = classes_of(ObjectLibrary.load(APC11))
    return write_weights_of(tmp_path / "own.safetensors", classes)


@pytest.fixture(autouse=True)
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Estimates are the truth, for what was detected: the command is what is tested.

    Gives the methods that were asked for an estimate.
    """
    asked: list[str] = []
    truth = {g.object_id: g.X_CO for g in BopDataset(SCENE).ground_truth(1, 0)}

    def estimate(
        self: PoseEstimator,
        observation: RgbdObservation,
        detections: Sequence[Detection],
        surface_height: float | None = None,
    ) -> SceneEstimate:
        asked.append(str(self._config.method))
        objects = []
        for d in detections:
            X_CO = truth[d.object_id] if d.seen else None
            objects.append(ObjectEstimate(d.object_id, "", X_CO, X_CO, 0.9, ""))
        surface = SupportSurface(np.eye(4), np.eye(4))
        found = tuple(detections)
        return SceneEstimate(tuple(objects), surface, "true", {}, (), found)

    quality = HypothesisQuality((), 1.0, 1, 1.0)
    monkeypatch.setattr(PoseEstimator, "estimate", estimate)
    monkeypatch.setattr(Study, "hypothesis_quality", lambda self: quality)
    return asked


def figures(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "out" / "report.json").read_text())
    return found


def test_a_network_runs_beside_the_given_boxes(
    run: Run, weights: Path, tmp_path: Path
) -> None:
    methods = ("--methods", "physim-heuristic,fcn-pca-icp")
    assert run(*methods, "--detector", "--weights", weights) == 0
    report = figures(tmp_path)
    found = {name: m["overall"]["found"] for name, m in report["methods"].items()}
    assert found == {
        "physim-heuristic": 1.0,
        "fcn-pca-icp": pytest.approx(2 / 3),
        "physim-heuristic, detector": pytest.approx(2 / 3),
    }
    loss = report["detector"]["physim-heuristic, detector"]
    assert (loss["missed"], loss["gained"]) == (1, 0)
    assert loss["rotation"] > 1
    assert loss["rotation_found"] == loss["translation_found"] == 0.0
    page = (tmp_path / "out" / "index.html").read_text()
    assert "1 objects are found with given detections only" in page
    assert report["notes"] == []


def test_a_missing_row_is_explained(
    run: Run,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(batch, "DETECTOR", tmp_path / "none")
    command = sys.modules["physim_drake.cli.report"]
    monkeypatch.setattr(command, "_METHODS", "pca-icp,fcn-pca-icp")
    assert run("--methods", "pca-icp,fcn-pca-icp") == 0
    assert "fcn-pca-icp is missing: " in capsys.readouterr().err
    report = figures(tmp_path)
    assert list(report["methods"]) == ["pca-icp"]
    assert "none: cannot be read" in report["notes"][0]
    assert "fcn-pca-icp is missing" in (tmp_path / "out" / "index.html").read_text()


THREE = ("--methods", "physim-heuristic,super4pcs-icp,pca-icp")


def test_a_report_that_was_cut_off_goes_on(
    run: Run, asked: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    assert run(*THREE) == 0
    whole = {p.name: p.read_bytes() for p in out.iterdir() if p.suffix != ".progress"}
    shutil.rmtree(out)
    quick = PoseEstimator.estimate

    def cut_off(self: PoseEstimator, *arguments: Any) -> SceneEstimate:
        if self._config.method == "pca-icp":
            raise InputError("the machine", "stopped")
        return quick(self, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(PoseEstimator, "estimate", cut_off)
        assert run(*THREE, "--resume") == 2
    assert [path.name for path in out.iterdir()] == ["report.progress"]
    asked.clear()
    assert run(*THREE, "--resume", "--workers", 2, "--vsd") == 0
    assert asked == ["pca-icp"]
    asked.clear()
    assert run(*THREE, "--resume") == 0
    assert asked == []
    assert whole == {
        p.name: p.read_bytes() for p in out.iterdir() if p.suffix != ".progress"
    }
    assert run(*THREE) == 0
    assert len(asked) == 3


def test_what_is_kept_is_small_though_masks_are_large(run: Run, tmp_path: Path) -> None:
    assert run("--methods", "pca-icp", "--masks") == 0
    assert (tmp_path / "out" / "report.progress").stat().st_size < 10_000


@pytest.mark.parametrize(
    ("others", "field"),
    [
        (("--seed", "1"), "seed"),
        (("--methods", "pca-icp"), "methods"),
        (("--hypotheses", "5"), "hypotheses"),
        (("--masks",), "detections"),
        (("--plain",), "plain"),
    ],
)
def test_other_settings_cannot_resume(
    others: tuple[str, ...],
    field: str,
    run: Run,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run("--methods", "physim-heuristic") == 0
    capsys.readouterr()
    assert run("--methods", "physim-heuristic", *others, "--resume") == 2
    (line,) = capsys.readouterr().err.splitlines()
    path = tmp_path / "out" / "report.progress"
    assert line.startswith(f"error: {path}: {field}: the run began with ")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--methods", "magic"], "--methods: 'magic' is not a method"),
        (["--methods", ","], "--methods: names no method"),
        (["--methods", "fcn-pca-icp"], "none: cannot be read"),
        (["--methods", "pca-icp", "--detector"], "needs a method that searches"),
    ],
)
def test_what_cannot_be_done_is_one_line(
    run: Run,
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(batch, "DETECTOR", tmp_path / "none")
    assert run(*arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert message in line
