# SPDX-License-Identifier: MIT
"""The study and its page, on the bundled example scene with a small budget."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physim_drake.batch.detection_source import DetectionSource
from physim_drake.datasets.bop import BopDataset
from physim_drake.errors import InputError
from physim_drake.estimation.estimator import EstimationConfig, Method
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary
from physim_drake.reporting import study as study_module
from physim_drake.reporting.study import HypothesisQuality, MethodRun, Study
from physim_drake.reporting.study_notes import StudyNotes
from physim_drake.reporting.study_page import write_report
from physim_drake.storage.progress_file import ProgressFile

EXAMPLE = Path(__file__).parents[2] / "examples" / "data" / "tabletop"


@pytest.fixture(scope="module")
def study() -> Study:
    dataset = BopDataset(EXAMPLE, models=APC11)
    library = ObjectLibrary.load(APC11, {t.object_id for t in dataset.targets()})
    source = DetectionSource.default(dataset)
    config = EstimationConfig().with_budget(12, 8)
    return Study(dataset, library, source.look_up, source.name, config)


@pytest.fixture(scope="module")
def runs(study: Study) -> list[MethodRun]:
    methods = (Method.PHYSIM_MCTS, Method.PCA_ICP)
    return [study.run(method, None) for method in methods]


@pytest.fixture(scope="module")
def quality(study: Study) -> HypothesisQuality:
    return study.hypothesis_quality()


def test_every_method_is_judged_on_every_target(
    study: Study, runs: list[MethodRun]
) -> None:
    wanted = sum(target.count for target in study.dataset.targets())
    assert [run.report.overall.targets for run in runs] == [wanted, wanted]


def test_only_searching_methods_have_a_curve(runs: list[MethodRun]) -> None:
    curve = runs[0].curve
    np.testing.assert_array_equal(curve[:, 0], np.arange(1, 13))
    assert np.isfinite(curve).all()
    assert len(runs[1].curve) == 0


def test_selecting_by_the_truth_beats_selecting_by_score(
    quality: HypothesisQuality,
) -> None:
    by_metric = {row.metric: row for row in quality.rows}
    score = by_metric["all hypotheses, best LCP"]
    rotation = by_metric["all hypotheses, least rotation error"]
    translation = by_metric["all hypotheses, least translation error"]
    assert rotation.rotation_deg <= score.rotation_deg
    assert translation.translation_cm <= score.translation_cm
    kept = by_metric["representatives, least rotation error"]
    assert kept.rotation_deg >= rotation.rotation_deg
    assert 0.0 <= quality.success <= 1.0


def test_page_needs_nothing_from_outside(
    study: Study, runs: list[MethodRun], quality: HypothesisQuality, tmp_path: Path
) -> None:
    page = write_report(study, runs, quality, tmp_path).read_text()
    assert "http:" not in page  # four letters alone may occur in picture data
    assert "https:" not in page
    assert page.count("data:image/png;base64,") == 3  # two curves, reliability
    assert "What confidences are worth" in page
    assert page.count("data:image/jpeg;base64,") == len(study.images)
    for run in runs:
        assert str(run.method) in page


def test_tables_hold_what_the_page_shows(
    study: Study, runs: list[MethodRun], quality: HypothesisQuality, tmp_path: Path
) -> None:
    write_report(study, runs, quality, tmp_path)
    with (tmp_path / "table1.csv").open() as file:
        rows = list(csv.DictReader(file))
    overall = runs[0].report.overall
    assert rows[0]["method"] == "physim-mcts"
    assert float(rows[0]["all rotation_deg"]) == pytest.approx(
        overall.rotation_mean_deg, rel=1e-5
    )
    figures = json.loads((tmp_path / "report.json").read_text())
    assert figures["hypotheses"]["success"] == quality.success
    with (tmp_path / "errors.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 2 * overall.targets


def test_same_study_writes_the_same_bytes(
    study: Study, runs: list[MethodRun], quality: HypothesisQuality, tmp_path: Path
) -> None:
    again = [study.run(run.method, None) for run in runs]
    for name, result in (("a", runs), ("b", again)):
        (tmp_path / name).mkdir()
        write_report(study, result, quality, tmp_path / name)
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes(), path


def test_what_was_noted_is_not_done_again(
    study: Study,
    runs: list[MethodRun],
    quality: HypothesisQuality,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And gives the same bytes."""

    def report(folder: str, resume: bool) -> None:
        path = tmp_path / "report.progress"
        with ProgressFile(path, {}, tmp_path) as progress:
            notes = StudyNotes(progress, progress.go_on(resume))
            noted = replace(study, notes=notes)
            again = noted.hypothesis_quality()
            results = [noted.run(run.method, None) for run in runs]
        (tmp_path / folder).mkdir()
        write_report(study, results, again, tmp_path / folder)

    (tmp_path / "unbroken").mkdir()
    write_report(study, runs, quality, tmp_path / "unbroken")
    report("noted", False)
    monkeypatch.delattr(study_module, "PoseEstimator")
    monkeypatch.delattr(study_module, "make_estimator")
    report("resumed", True)
    for path in (tmp_path / "unbroken").iterdir():
        for other in ("noted", "resumed"):
            assert path.read_bytes() == (tmp_path / other / path.name).read_bytes()


def test_missing_folder_is_an_input_error(
    study: Study, runs: list[MethodRun], tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        write_report(study, runs, None, tmp_path / "missing")
