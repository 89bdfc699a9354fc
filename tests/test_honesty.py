# SPDX-License-Identifier: MIT
"""A model that is not what stands there is not found, or found without confidence."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import trimesh

from physim_drake.estimate import ObjectEstimate
from physim_drake.estimation import estimate_scene
from physim_drake.objects import ObjectLibrary, ObjectModel
from physim_drake.observation import Detection, RgbdObservation
from physim_drake.poses import SymmetryGroup, inverse, make_pose
from physim_drake.rendering.depth import DepthRenderer
from physim_drake.search.states import composite
from tests.synthetic import (
    CAMERA,
    X_WC,
    l_shape,
    mask_box,
    noisy,
    plane_depth,
    pose_error,
    turned,
)
from tests.test_estimation import quick

X_WO = make_pose(turned("z", 35), [-0.03, -0.02, 0.0])


@cache
def seen() -> tuple[RgbdObservation, Detection]:
    """The shape on a table, and the box around it."""
    image = DepthRenderer({1: l_shape()}, CAMERA).render(1, inverse(X_WC) @ X_WO)
    table = plane_depth(CAMERA, X_WC, [0.0, 0.0, 1.0], 0.0)
    depth = noisy(composite(table, image), 0.5, 0)
    return RgbdObservation(depth, CAMERA, None, X_WC), Detection(1, mask_box(image > 0))


def changed(scale: tuple[float, float, float]) -> trimesh.Trimesh:
    mesh = l_shape().mesh.copy()
    mesh.apply_scale(scale)
    if np.prod(scale) < 0 and mesh.volume < 0:
        mesh.invert()
    return mesh


def estimated(mesh: trimesh.Trimesh, detection: Detection) -> ObjectEstimate:
    model = ObjectModel.from_mesh(1, "shape", mesh, symmetry=SymmetryGroup())
    library = ObjectLibrary([model], "changed")
    (found,) = estimate_scene(seen()[0], library, [detection], quick()).objects
    return found


def test_the_right_model_is_found_with_confidence() -> None:
    found = estimated(l_shape().mesh, seen()[1])
    assert found.X_WO is not None
    distance, angle = pose_error(found.X_WO, X_WO, SymmetryGroup())
    assert (distance < 10) & (angle < 5)
    assert found.confidence > 0.9


@pytest.mark.parametrize(
    "scale",
    [(-1.0, 1.0, 1.0), (1.25, 1.25, 1.25), (0.8, 0.8, 0.8)],
    ids=["mirrored", "larger", "smaller"],
)
def test_a_model_that_is_mirrored_or_scaled_has_little_confidence(
    scale: tuple[float, float, float],
) -> None:
    found = estimated(changed(scale), seen()[1])
    assert found.confidence < 0.9


def test_an_object_that_is_not_there_is_not_found() -> None:
    bare = Detection(1, np.array([4.0, 180.0, 54.0, 230.0]))
    found = estimated(l_shape().mesh, bare)
    assert not found.found
    assert found.confidence == 0
    assert "segment has" in found.reason
