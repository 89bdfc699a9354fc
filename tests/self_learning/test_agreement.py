# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest

from physim_drake.poses import Array, make_pose
from physim_drake.scene_estimate import ObjectEstimate
from physim_drake.self_learning.agreement import (
    AgreementConfig,
    EstimatedView,
    agreed_objects,
)
from tests.self_learning.views import CAMERAS, estimate, seen_from
from tests.synthetic import (
    BALL,
    BOOK,
    COFFEE,
    ERASER,
    SOAP,
    library,
    perturbed,
    resting,
    turned,
)

X_SOAP = resting(SOAP, turned("z", 30), 0.0, 0.0)
X_COFFEE = resting(COFFEE, turned("x", 90), 0.1, 0.05)


@pytest.fixture(scope="module")
def image():
    return seen_from([(SOAP, X_SOAP)], CAMERAS[0])[1]


def merge(image, *views: list[ObjectEstimate]):
    estimated = [EstimatedView(image, (), tuple(view)) for view in views]
    return agreed_objects(estimated, library())


def near(X: Array, seed: int) -> Array:
    return perturbed(X, 0.002, np.radians(1.0), seed)


def test_the_surest_of_the_views_that_agree_is_taken(image):
    sure = estimate(SOAP, near(X_SOAP, 1), confidence=0.98)
    other = estimate(SOAP, near(X_SOAP, 2), confidence=0.9)
    (found,) = merge(image, [other], [], [sure])
    assert found.object_id == SOAP
    assert found.views == (0, 2)
    assert found.confidence == 0.98
    np.testing.assert_array_equal(found.X_WO, sure.X_WO)


def test_one_view_is_not_enough_even_with_two_estimates(image):
    twice = [estimate(SOAP, near(X_SOAP, 1)), estimate(SOAP, near(X_SOAP, 2))]
    assert merge(image, twice, []) == ()


@pytest.mark.parametrize(
    "other",
    [
        estimate(SOAP, make_pose(p=[0.03, 0.0, 0.0]) @ X_SOAP),
        estimate(SOAP, X_SOAP @ make_pose(turned("x", 40))),
        estimate(SOAP, X_SOAP, confidence=0.5),
        estimate(ERASER, X_SOAP),
        ObjectEstimate(SOAP, "soap", None, None, 0.0, "not there"),
    ],
    ids=["elsewhere", "turned", "unsure", "another object", "not found"],
)
def test_views_that_do_not_agree(image, other: ObjectEstimate):
    assert merge(image, [estimate(SOAP, X_SOAP)], [other]) == ()


def test_symmetric_objects_agree_under_their_symmetries(image):
    """A box turned half around is the same, as is a tin at any angle about its axis."""
    half = make_pose(turned("z", 180))
    flipped = next(
        X
        for X in library()[SOAP].symmetry.discrete
        if not np.allclose(X, np.eye(4), atol=1e-6)
    )
    about = library()[COFFEE].symmetry.axes[0].pose(1.0)
    found = merge(
        image,
        [estimate(SOAP, X_SOAP), estimate(COFFEE, X_COFFEE)],
        [estimate(SOAP, X_SOAP @ flipped), estimate(COFFEE, X_COFFEE @ about)],
    )
    assert {o.object_id for o in found} == {SOAP, COFFEE}
    assert not np.allclose(X_SOAP @ half, X_SOAP)


def test_of_two_objects_in_one_place_more_views_decide(image):
    """The eraser is as wide as the soap: views may take one for the other."""
    X_ERASER = X_SOAP.copy()
    soap, eraser = estimate(SOAP, X_SOAP), estimate(ERASER, X_ERASER, confidence=0.99)
    found = merge(image, [soap], [soap], [soap, eraser], [eraser])
    assert [o.object_id for o in found] == [SOAP]


def test_objects_on_each_other_are_no_contradiction(image):
    height = float(library()[BOOK].extents[0])
    X_BOOK = resting(BOOK, turned("y", 90), 0.0, 0.0)
    X_ON_IT = resting(BALL, np.eye(3), 0.0, 0.0, height)
    view = [estimate(BOOK, X_BOOK), estimate(BALL, X_ON_IT)]
    assert len(merge(image, view, view)) == 2


def test_two_of_a_kind_are_told_apart(image):
    X_OTHER = make_pose(p=[0.2, 0.0, 0.0]) @ X_SOAP
    view = [estimate(SOAP, X_SOAP), estimate(SOAP, X_OTHER)]
    found = merge(image, view, view)
    assert [o.object_id for o in found] == [SOAP, SOAP]
    assert found[0].views == found[1].views == (0, 1)


def test_more_views_may_be_asked_for(image):
    view = EstimatedView(image, (), (estimate(SOAP, X_SOAP),))
    config = AgreementConfig(min_views=3)
    assert agreed_objects([view] * 2, library(), config) == ()
    assert len(agreed_objects([view] * 3, library(), config)) == 1
