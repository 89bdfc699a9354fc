# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest

from physim_drake.picking.viewpoints import look_at, propose_viewpoints

TARGET = np.array([0.6, 0.1, 0.75])
ROBOT = np.array([0.1, 0.1, 0.0])


def test_views_are_proposed_side_by_side_in_order() -> None:
    views = list(propose_viewpoints(TARGET, ROBOT))
    names = [view.name for view in views]
    assert list(dict.fromkeys(names)) == ["front", "left", "right", "top"]
    assert names == sorted(names, key=["front", "left", "right", "top"].index)
    first = {view.name: view.X_WC[:3, 3] - TARGET for view in reversed(views)}
    assert first["front"][0] < -0.2  # the robot faces along x
    assert first["left"][1] > 0.2
    assert first["right"][1] < -0.2
    np.testing.assert_allclose(first["top"], [0, 0, 0.45], atol=1e-12)


def test_every_view_looks_at_the_target_from_its_distance() -> None:
    for view in propose_viewpoints(TARGET, ROBOT, (0.4,), (0.9, 1.2)):
        p_CT = view.X_WC[:3, :3].T @ (TARGET - view.X_WC[:3, 3])
        np.testing.assert_allclose(p_CT, [0, 0, 0.4], atol=1e-12)


@pytest.mark.parametrize("eye", [[0.3, -0.4, 1.2], [0.6, 0.1, 1.2], [0.6, 0.1, 0.2]])
def test_the_camera_is_level_and_right_handed(eye: list[float]) -> None:
    X_WC = look_at(np.array(eye), TARGET)
    R = X_WC[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1)
    assert R[2, 0] == pytest.approx(0)
    if eye[:2] != [0.6, 0.1]:
        assert R[2, 1] < 0  # image down is down
