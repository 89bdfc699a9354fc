# SPDX-License-Identifier: MIT
"""The helpers that users build their integration tests on."""

from __future__ import annotations

import numpy as np
import pytest

from physim_drake.datasets.bop import GroundTruthPose
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.support_surface import SupportSurface
from physim_drake.poses import Array, exp_pose, make_pose
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from physim_drake.testing import assert_poses_close, compare_poses
from tests.synthetic import BALL, ERASER, SOAP, library

SURFACE = SupportSurface(np.eye(4), np.eye(4))


@pytest.fixture(scope="module")
def objects() -> ObjectLibrary:
    return library()


def pose(x: float = 0.0, angle_deg: float = 0.0) -> Array:
    return make_pose(
        exp_pose(np.radians([0.0, 0.0, angle_deg, 0, 0, 0]))[:3, :3], [x, 0.0, 0.6]
    )


def truth(object_id: int, X_CO: Array) -> GroundTruthPose:
    return GroundTruthPose(object_id, X_CO, None, None)


def estimate(objects: ObjectLibrary, *found: tuple[int, Array | None]) -> SceneEstimate:
    entries = tuple(
        ObjectEstimate(i, objects[i].name, X, X, 0.0 if X is None else 1.0, "")
        for i, X in found
    )
    return SceneEstimate(entries, SURFACE, "test", {})


def test_poses_within_the_limits_pass(objects: ObjectLibrary) -> None:
    assert_poses_close(
        estimate(objects, (ERASER, pose(0.004, 2.0))),
        [truth(ERASER, pose())],
        objects,
        max_rotation_deg=2.1,
        max_translation_m=0.005,
    )


def test_message_names_the_object_and_how_far_off_it_is(
    objects: ObjectLibrary,
) -> None:
    wrong = estimate(objects, (ERASER, pose(0.02, 10.0)), (SOAP, pose(0.2)))
    with pytest.raises(AssertionError) as caught:
        assert_poses_close(
            wrong, [truth(ERASER, pose()), truth(SOAP, pose(0.2))], objects
        )
    message = str(caught.value)
    assert "1 of 2 objects" in message
    assert f"{objects[ERASER].name}: off by 10.00 deg, 20.0 mm" in message
    assert objects[SOAP].name not in message


def test_missing_object_fails(objects: ObjectLibrary) -> None:
    with pytest.raises(AssertionError, match="not found"):
        assert_poses_close(
            estimate(objects, (ERASER, None)), [truth(ERASER, pose())], objects
        )


def test_symmetric_equivalents_are_equal(objects: ObjectLibrary) -> None:
    half_turn = pose(0.0, 180.0)
    compared = compare_poses(
        estimate(objects, (ERASER, half_turn)), [truth(ERASER, pose())], objects
    )
    assert compared[0].rotation_deg == pytest.approx(0.0, abs=1e-4)


def test_instances_are_matched_to_the_nearest_truth(objects: ObjectLibrary) -> None:
    found = estimate(objects, (BALL, pose(0.3)), (BALL, pose(0.1)))
    compared = compare_poses(
        found, [truth(BALL, pose(0.1)), truth(BALL, pose(0.31))], objects
    )
    assert [c.translation for c in compared] == pytest.approx([0.0, 0.01])


def test_one_of_two_instances_missing_is_noticed(objects: ObjectLibrary) -> None:
    compared = compare_poses(
        estimate(objects, (BALL, pose(0.3))),
        [truth(BALL, pose(0.1)), truth(BALL, pose(0.3))],
        objects,
    )
    assert [c.rotation_deg is None for c in compared] == [True, False]
