# SPDX-License-Identifier: MIT
"""A few kills of tiny runs. benchmarks/kills.py makes as many as it is told to."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.kill_cases import Case, estimate_case, few_models, train_case
from benchmarks.kills import Tally, cut_off
from physim_drake.models import APC11
from tests.cli.estimating import two_images


def check(tally: Tally, kills: int) -> None:
    assert tally.kills >= kills
    assert tally.runs >= 1
    assert tally.same == tally.runs, tally.wrong
    assert tally.wrong == []
    assert tally.orphans == tally.litter == 0


def test_estimates_survive_kills_on_one_worker_or_two(tmp_path: Path) -> None:
    tally = Tally()
    dataset = two_images(tmp_path / "two")
    case = estimate_case(dataset, "--models", str(APC11))
    case = replace(case, workers=(2,))
    cut_off(case, tmp_path / "runs", 3, np.random.default_rng(1), tally)
    check(tally, 3)


def test_generated_scenes_survive_kills_on_one_worker_or_two(tmp_path: Path) -> None:
    case = Case(
        "generate",
        ("--scenes", "2", "--objects", "2:2", "--levels", "1", "--seed", "5"),
        lambda out: (str(out / "scenes"),),
    )
    tally = Tally()
    cut_off(case, tmp_path / "runs", 3, np.random.default_rng(2), tally)
    check(tally, 3)


def test_a_training_survives_a_kill(tmp_path: Path) -> None:
    case = train_case(few_models(tmp_path / "models", 2))
    tally = Tally()
    cut_off(case, tmp_path / "runs", 1, np.random.default_rng(3), tally)
    check(tally, 1)
