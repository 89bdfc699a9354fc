# SPDX-License-Identifier: MIT
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from physim_drake.camera import CameraIntrinsics
from physim_drake.datasets.bop import GroundTruthPose
from physim_drake.evaluation.matching import (
    ObjectError,
    ObjectPose,
    match_detections_with_truth,
    match_objects,
    object_errors,
    poses_in_camera,
    poses_in_world,
    visible_instances,
)
from physim_drake.observation.observation import Detection
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


def errors(
    found: SceneEstimate, *true: tuple[str, int, Array]
) -> tuple[ObjectError, ...]:
    poses = [ObjectPose(name, object_id, X) for name, object_id, X in true]
    return object_errors(poses_in_world(found), poses, library())


def test_errors_are_those_of_the_nearest_symmetric_pose() -> None:
    (error,) = errors(
        estimate((ERASER, pose(0.003, 182.0))), ("eraser", ERASER, pose(0.0))
    )
    assert error.found
    assert error.rotation_deg == pytest.approx(2.0, abs=1e-3)
    assert error.rotation == pytest.approx(np.radians(2.0), abs=1e-5)
    assert error.translation == pytest.approx(0.003, abs=1e-6)
    assert error.confidence == 0.7
    assert str(error) == "eraser: off by 2.00 deg, 3.0 mm, confidence 0.70"


def test_what_is_not_found_says_so() -> None:
    missed = errors(
        estimate((SOAP, None)), ("a", SOAP, pose(0.0)), ("b", ERASER, pose(0.2))
    )
    assert [str(e) for e in missed] == ["a: not found", "b: not found"]
    assert not any(e.found or e.within(180.0, 1.0) for e in missed)


def test_an_error_is_within_limits_that_both_parts_keep() -> None:
    error = ObjectError("soap", SOAP, np.radians(4.0), 0.009)
    assert error.within(5.0, 0.01)
    assert not error.within(3.0, 0.01)
    assert not error.within(5.0, 0.008)


def test_instances_of_one_object_are_matched_as_a_whole() -> None:
    matched = errors(
        estimate((BALL, pose(0.31)), (SOAP, pose(0.5)), (BALL, pose(0.11))),
        ("left", BALL, pose(0.1)),
        ("soap", SOAP, pose(0.5)),
        ("right", BALL, pose(0.3)),
    )
    assert [e.name for e in matched] == ["left", "soap", "right"]
    assert [e.translation for e in matched] == pytest.approx([0.01, 0.0, 0.01])


def test_the_nearest_of_two_true_instances_gets_a_lone_estimate() -> None:
    matched = errors(
        estimate((BALL, pose(0.29))), ("a", BALL, pose(0.0)), ("b", BALL, pose(0.3))
    )
    assert [e.found for e in matched] == [False, True]


def test_costs_add_up_to_the_least_where_the_nearest_first_would_not() -> None:
    costs = np.array([[1.0, 2.0], [2.0, 9.0]])
    assert match_objects([BALL, BALL], [BALL, BALL], costs) == [1, 0]


def test_other_objects_are_never_matched_however_near() -> None:
    assert match_objects([BALL, SOAP], [SOAP], np.array([[0.0], [9.0]])) == [None, 0]
    assert match_objects([BALL], [], np.zeros((1, 0))) == [None]


def test_poses_are_those_of_the_frame_that_is_asked_for() -> None:
    both = ObjectEstimate(SOAP, "soap", pose(0.1), pose(0.2), 0.5, "")
    missed = ObjectEstimate(BALL, "ball", None, None, 0.0, "")
    scene = SceneEstimate((both, missed), SURFACE, "test", {})
    for poses, x in ((poses_in_camera(scene), 0.1), (poses_in_world(scene), 0.2)):
        (only,) = poses
        assert (only.name, only.object_id, only.confidence) == ("soap", SOAP, 0.5)
        np.testing.assert_array_equal(only.X_FO, pose(x))


def shown(*fractions: float | None) -> list[GroundTruthPose]:
    return [GroundTruthPose(BALL, pose(0.1), fraction) for fraction in fractions]


def test_visible_instances_show_a_tenth_or_are_not_known() -> None:
    truth = [*shown(0.05, 0.1, None, 0.9), GroundTruthPose(SOAP, pose(0.0), 1.0)]
    assert visible_instances(truth, BALL, 1) == [1, 2, 3]


def test_the_most_visible_of_the_hidden_make_up_the_number() -> None:
    assert visible_instances(shown(0.02, 0.06, 0.0, 0.9), BALL, 2) == [1, 3]
    assert visible_instances(shown(0.02), BALL, 4) == [0]


CAMERA = CameraIntrinsics(640, 480, 600.0, 600.0, 320.0, 240.0)


def matched_x(
    boxes: Sequence[tuple[int, tuple[int, int, int, int]]],
    *truth: tuple[int, float, float | None],
) -> list[float | None]:
    """x of the true pose of each (object id, box), for (id, x, visible fraction)."""
    detections = [Detection(i, np.array(box, dtype=float)) for i, box in boxes]
    poses = [
        GroundTruthPose(i, make_pose(p=[x, 0, 0.6]), share) for i, x, share in truth
    ]
    found = match_detections_with_truth(detections, poses, CAMERA)
    return [None if t is None else float(t.X_CO[0, 3]) for t in found]


def test_truth_goes_to_the_detection_where_it_is_seen() -> None:
    boxes = [
        (1, (200, 220, 240, 260)),
        (1, (400, 220, 440, 260)),
        (2, (0, 0, 9, 9)),
    ]
    truth = [(1, 0.1, None), (1, -0.1, None)]
    assert matched_x(boxes, *truth) == [-0.1, 0.1, None]


def test_more_detections_than_true_poses_leave_some_without() -> None:
    boxes = [(1, (0, 0, 10, 10)), (1, (310, 230, 330, 250))]
    assert matched_x(boxes, (1, 0.0, None)) == [None, 0.0]


def test_two_detections_never_share_a_true_pose() -> None:
    boxes = [(1, (300, 220, 340, 260)), (1, (310, 220, 350, 260))]
    assert matched_x(boxes, (1, 0.0, None), (1, 0.3, None)) == [0.0, 0.3]


def test_a_hidden_instance_takes_no_detection_from_a_visible_one() -> None:
    box = [(1, (300, 220, 340, 260))]
    assert matched_x(box, (1, 0.0, 0.02), (1, 0.05, 0.8)) == [0.05]
    assert matched_x(box, (1, 0.0, 0.02)) == [0.0]


def test_without_detections_nothing_is_matched() -> None:
    assert matched_x([], (1, 0.0, None)) == []
