# SPDX-License-Identifier: MIT
"""A few kills of tiny runs; benchmarks/kills.py makes as many as it is told to."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.kill_cases import Case, estimate_case
from benchmarks.kills import Tally, cut_off
from physim_drake.models import APC11
from tests.cli.test_estimate import SCENE, edit, twice


@pytest.fixture
def two_images(tmp_path: Path) -> Path:
    """The example's image twice, with one object as the target."""
    root = tmp_path / "two"
    shutil.copytree(SCENE, root)
    scene = root / "test" / "000001"
    for name in ("rgb", "depth"):
        shutil.copy(scene / name / "000000.png", scene / name / "000001.png")
    for name in ("scene_camera.json", "scene_gt.json", "scene_gt_info.json"):
        edit(scene / name, lambda value: value | {"1": value["0"]})
    for name, key in (
        ("detections.json", "image_id"),
        ("test_targets_bop19.json", "im_id"),
    ):
        edit(root / name, lambda value, key=key: twice(value, key))
    return root


def check(tally: Tally, kills: int) -> None:
    assert tally.kills >= kills
    assert tally.runs >= 1
    assert tally.same == tally.runs, tally.wrong
    assert tally.wrong == []
    assert tally.orphans == tally.litter == 0


def test_estimates_survive_kills_on_one_worker_or_two(
    two_images: Path, tmp_path: Path
) -> None:
    tally = Tally()
    case = estimate_case(two_images, "--models", str(APC11))
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
