# SPDX-License-Identifier: MIT
"""What is reported of each object."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from physim_drake.estimation.config import EstimationConfig
from physim_drake.estimation.object_estimates import object_estimates
from physim_drake.estimation.preparation import PreparedScene
from physim_drake.estimation.scene_search import SearchedScene
from physim_drake.observation.observation import Detection
from physim_drake.poses import make_pose
from physim_drake.scene_estimate import ObjectEstimate
from tests.synthetic import SyntheticScene, library, pair_apart, synthesize, turned

X_SO = make_pose(turned("xyz", 20, -30, 40), [0.1, 0.2, 0.05])
CONFIG = EstimationConfig(least_confidence=0.5)


@cache
def made() -> SyntheticScene:
    return synthesize(pair_apart())


def prepared() -> PreparedScene:
    m = made()
    return PreparedScene(m.observation, m.detections, m.surface, m.scene())


def reported(
    searched: SearchedScene, confidence: float = 0.9, scene: PreparedScene | None = None
) -> ObjectEstimate:
    """Of the first object, if all that are placed have this confidence."""
    confidences = dict.fromkeys(searched.placed, confidence)
    scene = scene or prepared()
    return object_estimates(scene, searched, confidences, library(), CONFIG)[0]


def test_a_pose_is_given_in_camera_and_world() -> None:
    found = reported(SearchedScene({0: X_SO}))
    X_WC = made().observation.X_WC
    assert X_WC is not None
    assert found.X_CO is not None
    assert found.X_WO is not None
    np.testing.assert_allclose(found.X_CO, made().surface.X_CS @ X_SO, atol=1e-12)
    np.testing.assert_allclose(found.X_WO, X_WC @ found.X_CO, atol=1e-12)
    assert found.name == library()[made().detections[0].object_id].name


def test_without_a_camera_pose_the_world_is_that_of_the_surface() -> None:
    blind = replace(made().observation, X_WC=None)
    found = reported(
        SearchedScene({0: X_SO}), scene=replace(prepared(), observation=blind)
    )
    assert found.X_WO is not None
    np.testing.assert_allclose(found.X_WO, made().surface.X_WS @ X_SO, atol=1e-12)


def test_a_share_lowers_the_confidence_but_does_not_hide_the_object() -> None:
    found = reported(SearchedScene({0: X_SO}, shares={0: 0.5}), 0.8)
    assert found.found
    assert found.confidence == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("searched", "confidence", "reason"),
    [
        (SearchedScene({}), 0.0, "no pose of it fits its segment"),
        (
            SearchedScene({}, excluded=frozenset({0})),
            0.0,
            "no pose of it fits beside the other objects",
        ),
        (SearchedScene({0: X_SO}), 0.4999, "confidence 0.49 is below 0.50"),
    ],
)
def test_an_object_that_is_not_found_says_why(
    searched: SearchedScene, confidence: float, reason: str
) -> None:
    missing = reported(searched, confidence)
    assert missing.reason == reason
    assert missing.X_CO is missing.X_WO is None
    assert missing.confidence == 0


def test_an_object_without_points_says_how_many_are_needed() -> None:
    m = made()
    corner = replace(m.detections[0], box=np.array([0.0, 0.0, 2.0, 2.0]))
    few = replace(m, detections=(corner, *m.detections[1:]))
    scene = replace(prepared(), segmented=few.scene())
    assert "at least 30 are needed" in reported(SearchedScene({}), scene=scene).reason


def test_an_object_that_the_detector_missed_is_told_as_that() -> None:
    m = made()
    missed = Detection.unseen(m.detections[0].object_id, *m.observation.depth.shape)
    unseen = replace(m, detections=(missed, *m.detections[1:]))
    scene = replace(prepared(), segmented=unseen.scene())
    found = reported(SearchedScene({0: X_SO}), scene=scene)
    assert found.reason == "the detector did not see it"
