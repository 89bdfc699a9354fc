# SPDX-License-Identifier: MIT
"""The true poses, and the judge that compares estimates with them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem

from physim_drake.observation.support_surface import SupportSurface
from physim_drake.poses import Array, make_pose
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from physim_drake.systems.ground_truth import GroundTruthPoses
from physim_drake.systems.object_instances import ObjectInstance
from physim_drake.systems.pose_error_monitor import LookErrors, PoseErrorMonitor
from physim_drake.systems.stage import EACH_STEP, TimingConfig
from physim_drake.systems.stamped import Stamped
from tests.synthetic import SOAP, library
from tests.systems.looks import build, shown

SOAP_INSTANCE = ObjectInstance("soap", SOAP, 1)


def at(x: float) -> Array:
    return make_pose(p=[x, 0.0, 0.0])


class Moving(LeafSystem):
    """Body poses of a plant whose body 1 moves at 1 m/s."""

    def __init__(self) -> None:
        super().__init__()
        poses: Any = Value[list[RigidTransform]]
        self.DeclareAbstractOutputPort("body_poses", poses, self._show)

    def _show(self, context: Any, output: Any) -> None:
        X = RigidTransform([context.get_time(), 0.0, 0.0])
        output.set_value([RigidTransform(), X])


def estimate(x: float) -> SceneEstimate:
    found = ObjectEstimate(SOAP, "soap", at(x), at(x), 0.9, "")
    surface = SupportSurface(np.eye(4), np.eye(4))
    return SceneEstimate((found,), surface, "fake", {})


def test_true_poses_are_of_now_and_of_the_look() -> None:
    plant, truth = Moving(), GroundTruthPoses((SOAP_INSTANCE,), period=1.0)
    wire = (plant.get_output_port(), truth.GetInputPort("body_poses"))
    simulator = Simulator(build(plant, truth, connect=(wire,)))
    simulator.AdvanceTo(1.25)
    context = simulator.get_context()
    assert shown(truth, context, "true_poses")["soap"][0, 3] == pytest.approx(1.25)
    then = shown(truth, context, "look_poses")
    assert (then.number, then.time) == (2, 1.0)
    assert then.value["soap"][0, 3] == pytest.approx(1.0)


class Judged:
    """A monitor beside a moving plant, and an estimate port to be set by hand."""

    def __init__(self, timing: TimingConfig = EACH_STEP) -> None:
        plant, truth = Moving(), GroundTruthPoses((SOAP_INSTANCE,), period=1.0)
        self.monitor = PoseErrorMonitor(library(), (SOAP_INSTANCE,), timing)
        diagram = build(
            plant,
            truth,
            self.monitor,
            connect=(
                (plant.get_output_port(), truth.GetInputPort("body_poses")),
                (
                    truth.GetOutputPort("look_poses"),
                    self.monitor.GetInputPort("look_poses"),
                ),
            ),
        )
        self._context = diagram.CreateDefaultContext()
        self._simulator = Simulator(diagram, self._context)
        self.show(Stamped())

    def show(self, stamped: Stamped[SceneEstimate]) -> None:
        inner = self.monitor.GetMyMutableContextFromRoot(self._context)
        self.monitor.GetInputPort("scene_estimate").FixValue(inner, stamped)

    def advance_to(self, time: float) -> tuple[LookErrors, ...]:
        self._simulator.AdvanceTo(time)
        return shown(self.monitor, self._context, "pose_errors").value or ()


def test_an_estimate_is_compared_with_where_the_object_was_then() -> None:
    judged = Judged()
    assert judged.advance_to(1.5) == ()
    judged.show(Stamped(estimate(0.02), 0.0, 1))
    (first,) = judged.advance_to(2.5)
    assert (first.number, first.time, first.error) == (1, 0.0, "")
    assert first.objects[0].translation == pytest.approx(0.02)
    judged.show(Stamped(estimate(1.01), 1.0, 2))
    errors = judged.advance_to(3.5)
    assert errors[0] is first
    assert errors[1].objects[0].translation == pytest.approx(0.01)
    assert str(errors[1]) == (
        "look 2 at 1.000 s\n  soap: off by 0.00 deg, 10.0 mm, confidence 0.90"
    )


def test_a_look_without_an_estimate_stays_in_the_history() -> None:
    judged = Judged(TimingConfig(0.25))
    judged.show(Stamped(estimate(0.0), 0.0, 1))
    judged.advance_to(0.75)
    judged.show(Stamped(None, 1.0, 2, "no surface"))
    judged.advance_to(1.75)
    judged.show(Stamped(estimate(2.0), 2.0, 3))
    errors = judged.advance_to(2.75)
    assert [(e.number, e.error, len(e.objects)) for e in errors] == [
        (1, "", 1),
        (2, "no surface", 0),
        (3, "", 1),
    ]
    assert str(errors[1]) == "look 2 at 1.000 s: no surface"
