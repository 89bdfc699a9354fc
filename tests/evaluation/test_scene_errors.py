# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest

from physim_drake.evaluation.scene_errors import TruePose, object_errors
from physim_drake.observation.support_surface import SupportSurface
from physim_drake.poses import Array, exp_pose, make_pose
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from tests.synthetic import BALL, ERASER, SOAP, library

SURFACE = SupportSurface(np.eye(4), np.eye(4))


def pose(x: float, angle_deg: float = 0.0) -> Array:
    turn = exp_pose(np.radians([0.0, 0.0, angle_deg, 0, 0, 0]))[:3, :3]
    return make_pose(turn, [x, 0.0, 0.1])


def estimate(*found: tuple[int, Array | None]) -> SceneEstimate:
    objects = (
        ObjectEstimate(i, library()[i].name, X, X, 0.0 if X is None else 0.7, "")
        for i, X in found
    )
    return SceneEstimate(tuple(objects), SURFACE, "test", {})


def test_errors_are_those_of_the_nearest_symmetric_pose() -> None:
    (error,) = object_errors(
        estimate((ERASER, pose(0.003, 182.0))),
        {"eraser": TruePose(ERASER, pose(0.0))},
        library(),
    )
    assert error.found
    assert np.degrees(error.rotation or 0) == pytest.approx(2.0, abs=1e-3)
    assert error.translation == pytest.approx(0.003, abs=1e-6)
    assert error.confidence == 0.7
    assert str(error) == "eraser: off by 2.00 deg, 3.0 mm, confidence 0.70"


def test_what_is_not_found_says_so() -> None:
    truth = {"a": TruePose(SOAP, pose(0.0)), "b": TruePose(ERASER, pose(0.2))}
    errors = object_errors(estimate((SOAP, None)), truth, library())
    assert [str(e) for e in errors] == ["a: not found", "b: not found"]
    assert not any(e.found for e in errors)


def test_instances_of_one_object_are_matched_as_a_whole() -> None:
    truth = {
        "left": TruePose(BALL, pose(0.1)),
        "soap": TruePose(SOAP, pose(0.5)),
        "right": TruePose(BALL, pose(0.3)),
    }
    found = estimate((BALL, pose(0.31)), (SOAP, pose(0.5)), (BALL, pose(0.11)))
    errors = object_errors(found, truth, library())
    assert [e.name for e in errors] == ["left", "soap", "right"]
    assert [e.translation for e in errors] == pytest.approx([0.01, 0.0, 0.01])


def test_the_nearest_of_two_true_instances_gets_a_lone_estimate() -> None:
    truth = {"a": TruePose(BALL, pose(0.0)), "b": TruePose(BALL, pose(0.3))}
    errors = object_errors(estimate((BALL, pose(0.29))), truth, library())
    assert [e.found for e in errors] == [False, True]
