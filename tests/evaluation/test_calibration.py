# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest

from physim_drake.evaluation.calibration import EDGES, Calibration, reliability_figure
from physim_drake.evaluation.report import EvaluationReport, InstanceErrors


def calibration_of(*pairs: tuple[float, bool]) -> Calibration:
    result = Calibration.of([c for c, _ in pairs], [r for _, r in pairs])
    assert result is not None
    return result


def test_bins_count_what_claims_about_the_same() -> None:
    result = calibration_of((0.2, False), (0.4, True), (0.92, True), (1.0, True))
    assert [b.estimates for b in result.bins] == [2, 0, 0, 0, 1, 0, 1]
    assert result.bins[0].correct == 0.5
    assert result.bins[0].confidence == pytest.approx(0.3)
    assert result.bins[1].correct is None
    assert (result.sure, result.sure_correct) == (2, 1.0)
    assert result.gap == pytest.approx((2 * 0.2 + 0.08 + 0.0) / 4)


def test_claims_that_come_true_as_often_as_they_say_leave_no_gap() -> None:
    rng = np.random.default_rng(0)
    claims = rng.uniform(0, 1, 20_000)
    honest = Calibration.of(
        claims.tolist(), (rng.uniform(size=20_000) < claims).tolist()
    )
    boasting = Calibration.of(claims.tolist(), [False] * 20_000)
    assert honest is not None
    assert boasting is not None
    assert honest.gap < 0.02
    assert boasting.gap == pytest.approx(0.5, abs=0.02)
    assert boasting.sure_correct == 0.0


def test_every_edge_belongs_to_one_bin() -> None:
    result = calibration_of(*((edge, True) for edge in EDGES))
    assert sum(b.estimates for b in result.bins) == len(EDGES)
    assert result.bins[-1].estimates == 2


@pytest.mark.parametrize("scores", [[], [1.5], [-0.1, 0.5], [float("nan")]])
def test_scores_that_are_no_confidences(scores: list[float]) -> None:
    assert Calibration.of(scores, [True] * len(scores)) is None


def test_a_report_leaves_missed_targets_out() -> None:
    errors = [
        InstanceErrors(1, 0, 1, 0),
        InstanceErrors(1, 0, 2, 1, found=True, confidence=0.95, accepted=True),
        InstanceErrors(1, 0, 3, 2, found=True, confidence=0.91),
    ]
    report = EvaluationReport.of(errors, [None], 0)
    assert report.calibration is not None
    assert (report.calibration.sure, report.calibration.sure_correct) == (2, 0.5)
    assert "of 2 estimates that claim 0.9 or more, 0.500" in str(report.calibration)
    assert report.as_dict()["calibration"]["bins"][4]["estimates"] == 1


def test_the_diagram_shows_a_bar_and_a_count_for_each_bin_in_use() -> None:
    figure = reliability_figure(
        calibration_of((0.2, False), (0.99, True), (0.99, True))
    )
    (axes,) = figure.axes
    assert [bar.get_height() for bar in axes.patches] == [0.0, 1.0]
    assert [text.get_text() for text in axes.texts] == ["1", "2"]
