# SPDX-License-Identifier: MIT
"""The examples of perception beside a plant run, with small budgets."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import pytest

from physim_drake.systems import (
    EstimatorConfig,
    OracleDetectorConfig,
    PerceptionConfig,
)
from tests.examples.test_examples import FOLDER, load

QUICK = EstimatorConfig(expansions=12, representatives=8, rounds=1)


@pytest.fixture
def examples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(FOLDER)


@pytest.fixture
def settings(examples: None) -> PerceptionConfig:
    config = PerceptionConfig.load(FOLDER / "perception" / "perception.yaml")
    return replace(config, detector=OracleDetectorConfig(), estimator=QUICK)


def offsets(printed: str) -> dict[str, float]:
    """How far each object is said to be off, mm."""
    pattern = r"^  (\w+): off by [0-9.]+ deg, ([0-9.]+) mm"
    return {name: float(mm) for name, mm in re.findall(pattern, printed, re.MULTILINE)}


def test_a_scene_is_seen(
    settings: PerceptionConfig, capsys: pytest.CaptureFixture[str]
) -> None:
    load("perception_diagram").main(settings)
    printed = capsys.readouterr().out
    assert "look 1 at 1.000 s" in printed
    off = offsets(printed)
    assert set(off) == {"kleenex_tissue_box", "dove_beauty_bar", "up_glucose_bottle"}
    assert sorted(off.values())[1] < 10.0


def test_another_detector_is_asked(
    settings: PerceptionConfig, capsys: pytest.CaptureFixture[str]
) -> None:
    example: Any = load("replace_detector")
    detector = example.ColorDetector(settings.load_library(), example.NAMES)
    asked = []

    class Watched:
        def detect(self, observation: Any, labels: Any, generator: Any) -> Any:
            found = detector.detect(observation, None, generator)
            asked.append([d.object_id for d in found])
            return found

    example.main(settings, FOLDER / "perception" / "apart.dmd.yaml", Watched())
    assert [sorted(ids) for ids in asked] == [[1, 3, 9]]
    off = offsets(capsys.readouterr().out)
    assert set(off) == set(example.NAMES)
    assert max(off.values()) < 10.0
