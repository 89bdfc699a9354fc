# SPDX-License-Identifier: MIT
"""An integration test against simulated ground truth, to copy.

pytest examples/test_integration.py
"""

from __future__ import annotations

from collections.abc import Callable

import pytest

from physim_drake.estimation import PoseEstimator
from physim_drake.objects import ObjectLibrary
from physim_drake.testing import ObservedScene, assert_poses_close

pytest_plugins = ["physim_drake.pytest_plugin"]


@pytest.mark.parametrize("level", [1, 2])
def test_every_object_is_found(
    level: int,
    make_scene: Callable[..., ObservedScene],
    pose_estimator: PoseEstimator,
    object_library: ObjectLibrary,
) -> None:
    """Each object is where the simulator put it, within 5 degrees and 1 cm."""
    scene = make_scene(level=level, seed=0, objects=(2, 2))
    estimate = pose_estimator.estimate(scene.observation, scene.detections)
    assert_poses_close(
        estimate,
        scene.ground_truth,
        object_library,
        max_rotation_deg=5.0,
        max_translation_m=0.01,
    )
