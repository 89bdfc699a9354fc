# SPDX-License-Identifier: MIT
"""Whole episodes of a cell with one object."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from physim_drake.episodes.result import EpisodeResult, summary
from physim_drake.episodes.runner import EpisodeRunner, local_meshcat
from physim_drake.estimation.estimator import EstimationConfig, Method, PoseEstimator
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary
from physim_drake.picking.scenario import (
    DetectorName,
    LookConfig,
    ObjectsConfig,
    PickScenario,
)
from physim_drake.picking.task_state import EventKind
from physim_drake.poses import make_pose
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from physim_drake.systems.pick_cell import PickCellParts

ERASER = ObjectsConfig(str(APC11), ("expo_dry_erase_board_eraser",), (1, 1), (1,))
SCENARIO = PickScenario(
    objects=ERASER,
    look=LookConfig(
        noise=False,
        detector=DetectorName.ORACLE,
        expansions=10,
        method=Method.PCA_ICP,
    ),
)


class Shifted:
    """Estimates as another estimator does, and puts all objects elsewhere.

    Its slots let nobody replace its methods.
    """

    __slots__ = ("_estimator", "_shift")

    def __init__(self, estimator: PoseEstimator, shift: tuple[float, float, float]):
        self._estimator, self._shift = estimator, make_pose(p=shift)

    def estimate(self, *arguments: Any) -> SceneEstimate:
        estimate = self._estimator.estimate(*arguments)
        moved = tuple(self._moved(item) for item in estimate.objects)
        return replace(estimate, objects=moved)

    def _moved(self, item: ObjectEstimate) -> ObjectEstimate:
        if item.X_WO is None:
            return item
        return replace(item, X_WO=self._shift @ item.X_WO)


def run_shifted(shift: tuple[float, float, float]) -> EpisodeResult:
    library = ObjectLibrary.load(APC11)
    config = EstimationConfig(Method.PCA_ICP)
    with PoseEstimator(library, config) as estimator:
        moved: Any = Shifted(estimator, shift)
        task = replace(SCENARIO.task, tries=1)
        scenario = replace(SCENARIO, task=task)
        with EpisodeRunner(scenario, PickCellParts(estimator=moved)) as runner:
            return runner.run(0)


def without_wall_times(result: EpisodeResult) -> str:
    figures = summary([replace(result, stages={})])
    return json.dumps(figures)


@pytest.mark.timeout(300)
def test_picks_follow_the_estimate_and_not_the_truth() -> None:
    """Where the estimate is off by centimetres, the cup comes down beside."""
    true, off = run_shifted((0.0, 0.0, 0.0)), run_shifted((0.06, 0.06, 0.0))
    assert true.cleared == true.picks == 1
    assert off.cleared == 0
    assert off.picks == 1
    assert off.count(EventKind.NO_SEAL) == 1
    (error,) = off.looks[0].errors
    assert error.translation == pytest.approx(np.hypot(0.06, 0.06), abs=0.01)
    (left,) = off.objects
    assert "given up after 1 picks" in left.reason


@pytest.mark.timeout(300)
def test_a_second_run_gives_the_same_figures() -> None:
    scenario = replace(SCENARIO, max_duration=9.0)  # look, pick, place
    with EpisodeRunner(scenario) as runner:
        once = runner.run(0)
    with EpisodeRunner(scenario) as runner:
        runner.run(1)  # what was run before does not matter
        again = runner.run(0)
    assert once.count(EventKind.PICK) == 1
    assert without_wall_times(once) == without_wall_times(again)


@pytest.mark.timeout(300)
def test_an_episode_that_is_too_long_is_cut() -> None:
    with EpisodeRunner(replace(SCENARIO, max_duration=2.0)) as runner:
        result = runner.run(0)
    assert result.end == "2 s are over, the task is not"
    assert result.cleared == 0
    assert "it was never picked" in result.objects[0].reason
    assert set(result.stages) >= {"set-up", "simulation", "planning", "rendering"}
    assert result.simulated == pytest.approx(2.0)


def test_meshcat_listens_on_this_computer_only() -> None:
    meshcat = local_meshcat()
    assert meshcat.web_url().startswith("http://localhost:")
