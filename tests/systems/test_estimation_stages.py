# SPDX-License-Identifier: MIT
"""The generator of hypotheses and the estimator, on a fake algorithm."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from physim_drake import systems
from physim_drake.errors import InputError
from physim_drake.estimation.preparation import PreparedScene
from physim_drake.hypotheses.generation import PoseHypotheses
from physim_drake.scene_estimate import SceneEstimate
from physim_drake.systems.hypothesis_generator import (
    HypothesisGenerator,
    SceneHypotheses,
)
from physim_drake.systems.pose_estimator import SceneEstimator
from physim_drake.systems.stage import EACH_STEP, TimingConfig
from physim_drake.systems.stamped import Stamped
from tests.synthetic import SyntheticScene, pair_apart, synthesize
from tests.systems.looks import build, shown


class FakeEstimator:
    """Takes down what it is asked, and refuses what it is told to."""

    def __init__(self, made: SyntheticScene, refuses: str = "") -> None:
        self._made, self._refuses = made, refuses
        self.asked: list[tuple[Any, ...]] = []

    def prepare(
        self, observation: Any, detections: Any, surface_height: float | None = None
    ) -> PreparedScene:
        self._ask("prepare", detections, surface_height)
        made = self._made
        return PreparedScene(observation, detections, made.surface, made.scene())

    def hypotheses(self, prepared: PreparedScene) -> list[PoseHypotheses]:
        self._ask("hypotheses", prepared)
        none = np.zeros((0, 4, 4)), np.zeros(0), np.zeros(0, dtype=np.int64)
        return [PoseHypotheses(d.object_id, *none) for d in prepared.detections]

    def estimate_prepared(
        self, prepared: PreparedScene, hypotheses: Any = None
    ) -> SceneEstimate:
        self._ask("estimate prepared", prepared, hypotheses)
        return SceneEstimate((), self._made.surface, "fake", {})

    def estimate(
        self, observation: Any, detections: Any, surface_height: float | None = None
    ) -> SceneEstimate:
        self._ask("estimate", detections, surface_height)
        return SceneEstimate((), self._made.surface, "fake", {})

    def _ask(self, *question: Any) -> None:
        self.asked.append(question)
        if question[0] == self._refuses:
            raise InputError("support surface", "no plane found")


@pytest.fixture(scope="module")
def made() -> SyntheticScene:
    return synthesize(pair_apart())


def run(
    fake: FakeEstimator,
    made: SyntheticScene,
    with_generator: bool = True,
    timing: TimingConfig = EACH_STEP,
    end: float = 2.0,
) -> tuple[Stamped[SceneHypotheses], Stamped[SceneEstimate]]:
    """What both show after `end` s, of a look taken at 0."""
    generator = HypothesisGenerator(fake, 0.1, timing)
    estimator = SceneEstimator(fake, 0.1, timing)
    wire = (generator.GetOutputPort("hypotheses"), estimator.GetInputPort("hypotheses"))
    diagram = build(generator, estimator, connect=(wire,) if with_generator else ())
    context = diagram.CreateDefaultContext()
    look = {"observation": made.observation, "detections": made.detections}
    for system in (generator, estimator):
        inner = system.GetMyMutableContextFromRoot(context)
        for port, value in look.items():
            system.GetInputPort(port).FixValue(inner, Stamped(value, 0.0, 1))
    Simulator(diagram, context).AdvanceTo(end)
    return (
        shown(generator, context, "hypotheses"),
        shown(estimator, context, "scene_estimate"),
    )


def test_hypotheses_are_made_once_and_go_to_the_estimator(made: SyntheticScene) -> None:
    fake = FakeEstimator(made)
    hypotheses, estimate = run(fake, made)
    assert hypotheses.value is not None
    prepared = hypotheses.value.prepared
    assert fake.asked == [
        ("prepare", made.detections, 0.1),
        ("hypotheses", prepared),
        ("estimate prepared", prepared, hypotheses.value.objects),
    ]
    assert estimate.value is not None
    assert (estimate.value.method, estimate.number) == ("fake", 1)


def test_without_a_generator_the_estimator_makes_its_own(made: SyntheticScene) -> None:
    fake = FakeEstimator(made)
    run(fake, made, with_generator=False)
    assert [q for q in fake.asked if q[0].startswith("estimate")] == [
        ("estimate", made.detections, 0.1)
    ]


def test_computing_time_is_simulated(made: SyntheticScene) -> None:
    for end, numbers in (
        (0.45, (0, 0)),
        (0.65, (1, 0)),
        (1.05, (1, 0)),
        (1.25, (1, 1)),
    ):
        stamped = run(FakeEstimator(made), made, timing=TimingConfig(0.5), end=end)
        assert tuple(s.number for s in stamped) == numbers


@pytest.mark.parametrize("refuses", ["hypotheses", "estimate prepared"])
def test_an_image_without_a_surface_is_an_error_of_the_look(
    refuses: str, made: SyntheticScene
) -> None:
    fake = FakeEstimator(made, refuses)
    hypotheses, estimate = run(fake, made)
    assert estimate == Stamped(None, 0.0, 1, "support surface: no plane found")
    assert (hypotheses.value is None) == (refuses == "hypotheses")
    assert len(fake.asked) == (2 if refuses == "hypotheses" else 3)


def test_the_old_name_of_the_estimator_still_works() -> None:
    assert systems.MctsPoseEstimator is SceneEstimator
