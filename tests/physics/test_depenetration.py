# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest

from physim_drake.objects.model import ObjectModel
from physim_drake.physics.depenetration import depenetrate
from physim_drake.poses import Array, inverse, make_pose, transform_points
from physim_drake.registration.registration_model import registration_model
from tests.synthetic import BALL, SOAP, TISSUES, library, resting, turned

FLAT = turned("yz", 90, 40)
TISSUES_ON_TABLE = resting(TISSUES, np.eye(3), 0.0, 0.0)
HALF = library()[TISSUES].extents / 2
RADIUS = 0.035


def soap() -> ObjectModel:
    return library()[SOAP]


def overlap(model: ObjectModel, X: Array, other: ObjectModel, Y: Array) -> float:
    """Largest depth (m) of a surface point of one in the other."""
    a, b = registration_model(model), registration_model(other)
    in_b, _ = b.distance_field.query(transform_points(inverse(Y) @ X, a.points))
    in_a, _ = a.distance_field.query(transform_points(inverse(X) @ Y, b.points))
    return -min(0.0, float(in_a.min()), float(in_b.min()))


def test_what_overlaps_nothing_stays_where_it_is() -> None:
    X = resting(SOAP, FLAT, 0.0, 0.0, 2 * HALF[2] + 0.001)
    out = depenetrate(soap(), X, [(library()[TISSUES], TISSUES_ON_TABLE)])
    np.testing.assert_array_equal(out, X)
    out[0, 3] = 5.0
    assert X[0, 3] != 5.0


@pytest.mark.parametrize("depth", [0.002, 0.01, 0.02])
def test_out_of_the_table_it_goes_straight_up(depth: float) -> None:
    true = resting(SOAP, FLAT, 0.1, 0.2)
    X = depenetrate(soap(), make_pose(p=[0, 0, -depth]) @ true, [])
    np.testing.assert_allclose(X[:3, :3], true[:3, :3])
    np.testing.assert_allclose(X[:3, 3], true[:3, 3], atol=8e-4)


@pytest.mark.parametrize("depth", [0.002, 0.01])
def test_out_of_a_box_s_side_it_goes_sideways(depth: float) -> None:
    x = HALF[0] + RADIUS - depth
    start = make_pose(p=[x, 0.0, HALF[2]])
    X = depenetrate(library()[BALL], start, [(library()[TISSUES], TISSUES_ON_TABLE)])
    np.testing.assert_allclose(X[:3, 3] - start[:3, 3], [depth, 0, 0], atol=3e-3)


def test_between_the_table_and_a_box_it_leaves_both() -> None:
    start = make_pose(p=[HALF[0] + RADIUS - 0.006, 0.0, RADIUS - 0.006])
    other = library()[TISSUES]
    X = depenetrate(library()[BALL], start, [(other, TISSUES_ON_TABLE)])
    assert overlap(library()[BALL], X, other, TISSUES_ON_TABLE) < 8e-4
    assert X[2, 3] > RADIUS - 8e-4
    assert np.linalg.norm(X[:3, 3] - start[:3, 3]) < 0.015


def test_objects_far_away_do_not_matter() -> None:
    far = make_pose(p=[2.0, 0.0, 0.0]) @ TISSUES_ON_TABLE
    start = resting(SOAP, FLAT, 0.0, 0.0, -0.005)
    other = library()[TISSUES]
    np.testing.assert_array_equal(
        depenetrate(soap(), start, [(other, far)]), depenetrate(soap(), start, [])
    )


def test_it_does_not_go_far() -> None:
    start = make_pose(p=[0.0, 0.0, HALF[2]])
    X = depenetrate(library()[BALL], start, [(library()[TISSUES], TISSUES_ON_TABLE)])
    assert np.linalg.norm(X[:3, 3] - start[:3, 3]) < 0.04 + 1e-9
