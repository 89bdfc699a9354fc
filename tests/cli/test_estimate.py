# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from physim_drake.datasets.bop import BopDataset
from physim_drake.datasets.results import read_results
from physim_drake.estimation.config import LEAST_CONFIDENCE
from physim_drake.evaluation.evaluate import evaluate_results
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary
from physim_drake.pose_errors import pose_error
from tests.cli.estimating import (
    BOTTLE,
    SCENE,
    Run,
    edit,
    quick,
)
from tests.datasets.tiny import write_tiny


def test_estimates_the_example(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "results.csv"
    folders = ("--overlays", tmp_path / "pictures", "--trace", tmp_path / "traces")
    budget = ("--expansions", "24", "--workers", "2")
    assert run(SCENE, "--out", out, "--models", APC11, *budget, *folders) == 0
    captured = capsys.readouterr()
    assert "3 of 3 objects found" in captured.err
    assert captured.out == ""
    data = BopDataset(SCENE)
    truth = {pose.object_id: pose.X_CO for pose in data.ground_truth(1, 0)}
    library = ObjectLibrary.load(APC11, truth)
    rows = read_results(out)
    assert sorted(row.object_id for row in rows) == sorted(truth)
    for row in rows:
        symmetry = library[row.object_id].symmetry
        error = pose_error(truth[row.object_id], row.X_CO, symmetry)
        assert error.translation < 0.005
        assert np.degrees(error.geodesic) < 3.0
        assert row.score > 0.8
        assert row.time is not None
        assert row.time > 0.5
    picture = cv2.imread(str(tmp_path / "pictures" / "000001_000000.png"))
    assert picture is not None
    assert picture.shape == (480, 1280, 3)
    trace = json.loads((tmp_path / "traces" / "000001_000000.json").read_text())
    scores = [[p["score"] for p in g["points"]] for g in trace["groups"]]
    assert all(s == sorted(s) and len(s) > 0 for s in scores)
    assert set(trace["stages"]) >= {"hypotheses", "search", "refinement"}
    assert trace["method"] == "physim-mcts"


def test_images_chooses_several(run: Run, dataset: Path, tmp_path: Path) -> None:
    out = tmp_path / "r.csv"
    pca = ("--method", "pca-icp")
    assert run(*quick(dataset, out), *pca, "--images", "1/1", "1/0", "--masks") == 0
    assert [row.im_id for row in read_results(out)] == [1, 0]


def test_an_object_without_points_is_not_found(
    run: Run, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def moved(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
        return [entry | {"bbox": [250, 440, 30, 30]} for entry in entries]

    edit(dataset / "detections.json", moved)
    out = tmp_path / "r.csv"
    height = ("--surface", "0")
    assert run(*quick(dataset, out), "--images", "1/0", *height) == 0
    assert read_results(out) == []
    assert "1/0 up_glucose_bottle: not found: its segment has 0" in (
        capsys.readouterr().err
    )


def test_an_object_of_less_confidence_is_not_found(
    run: Run, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "r.csv"
    strict = (*quick(dataset, out), "--least-confidence", "1")
    assert run(*strict, "--images", "1/0") == 0
    assert read_results(out) == []
    said = capsys.readouterr().err
    assert "1/0 up_glucose_bottle: not found: confidence 0." in said
    assert "is below 1.00" in said
    data, library = BopDataset(dataset), ObjectLibrary.load(APC11, [BOTTLE])
    report = evaluate_results(data, read_results(out), library)
    assert [(e.found, e.confidence) for e in report.errors] == [(False, None)] * 2
    assert report.calibration is None
    assert run(*quick(dataset, out), "--resume") == 2
    assert "least_confidence: the run began with '1'" in capsys.readouterr().err
    assert run(*quick(dataset, out), "--images", "1/0") == 0
    assert len(read_results(out)) == 1


@pytest.mark.parametrize("least", ["-0.1", "1.1", "nan"])
def test_a_required_confidence_lies_between_0_and_1(
    run: Run, dataset: Path, tmp_path: Path, least: str
) -> None:
    out = tmp_path / "r.csv"
    assert run(*quick(dataset, out), f"--least-confidence={least}") == 2
    assert not out.exists()


def test_ground_truth_names_the_targets_where_nothing_else_does(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = write_tiny(tmp_path / "tiny")
    (root / "test_targets_bop19.json").unlink()
    arguments = ("--masks", "--models", APC11, "--images", "3/0")
    # The tiny image has too few pixels to find anything in.
    assert run(root, "--out", tmp_path / "r.csv", *arguments) == 0
    assert "3/0 " in capsys.readouterr().err


def test_the_help_says_how_much_confidence_is_required(
    run: Run, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "400")
    assert run("--help") == 0
    assert f"default: ({LEAST_CONFIDENCE:g}, or 0 with --plain" in (
        " ".join(capsys.readouterr().out.split())
    )
