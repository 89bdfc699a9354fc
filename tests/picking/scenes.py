# SPDX-License-Identifier: MIT
"""Estimates of scenes on a table at z = 0, as the picking tests want them."""

from __future__ import annotations

import numpy as np

from physim_drake.observation.support_surface import SupportSurface
from physim_drake.poses import Array, make_pose
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from tests.synthetic import Objects, library


def estimate_of(
    objects: Objects,
    confidences: tuple[float, ...] = (),
    X_WS: Array | None = None,
) -> SceneEstimate:
    """An estimate in which all objects were found.

    Args:
        objects: with poses on the table.
        confidences: one an object; 0.9 where there are fewer.
        X_WS: where the table is, (4, 4).
    """
    X = np.eye(4) if X_WS is None else X_WS
    sure = [*confidences, *[0.9] * len(objects)]
    return SceneEstimate(
        tuple(
            ObjectEstimate(i, library()[i].name, X @ X_SO, X @ X_SO, confidence, "")
            for (i, X_SO), confidence in zip(objects, sure, strict=False)
        ),
        SupportSurface(np.eye(4), X),
        "physim-mcts",
        {},
    )


def lifted(X: Array, height: float) -> Array:
    """The pose, higher by `height` (m)."""
    return make_pose(p=[0.0, 0.0, height]) @ X
