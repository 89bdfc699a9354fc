# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physim_drake.poses import Array, make_pose
from physim_drake.registration.registration_model import lookalike_turns
from physim_drake.reporting.explanation import Explanation, error_size
from physim_drake.reporting.explanation_words import (
    diagnosis,
    is_within,
    stage_errors,
    verdict,
)
from physim_drake.search.states import Confirmation
from tests.reporting.explained import BOTTLE, BOX, CRAYONS, bare, example

GOOD = Confirmation(1.0, 1.0)
FAR = make_pose(p=[0.0, 0.0, 0.1])


def with_confidence(confidence: float) -> Explanation:
    e = example()
    objects = list(e.estimate.objects)
    objects[BOX] = replace(objects[BOX], confidence=confidence)
    return replace(e, estimate=replace(e.estimate, objects=tuple(objects)))


def with_estimate(X_CO: Array, k: int = BOX) -> Explanation:
    e = example()
    objects = list(e.estimate.objects)
    objects[k] = replace(objects[k], X_CO=X_CO)
    return replace(e, estimate=replace(e.estimate, objects=tuple(objects)))


def test_a_confirmed_object_has_no_doubts() -> None:
    assert verdict(example(), BOX, GOOD) == "The depth image confirms it."


def test_little_doubt_is_called_little() -> None:
    text = verdict(with_confidence(0.92), BOX, Confirmation(0.96, 0.96))
    assert text == "The depth image nearly confirms it."


@pytest.mark.parametrize(
    ("confirmation", "said", "unsaid"),
    [
        (Confirmation(0.95, 0.95), "share the confidence", "measured depth"),
        (Confirmation(0.6, 0.95), "40% of the measured depth", "its segment"),
        (
            Confirmation(0.95, 0.5),
            "50% is explained by no object",
            "measured depth is not",
        ),
    ],
)
def test_doubts_name_the_share_that_is_low(
    confirmation: Confirmation, said: str, unsaid: str
) -> None:
    text = verdict(with_confidence(0.5), BOX, confirmation)
    assert text.startswith("The depth image does not confirm it.")
    assert said in text
    assert unsaid not in text


def test_a_confidence_that_is_shared_is_no_doubt_about_the_fit() -> None:
    text = verdict(with_confidence(0.5), BOX, GOOD)
    assert "agrees" in text
    assert "Other poses" in text


def test_not_found_says_why_and_what_may_be_behind_it() -> None:
    text = verdict(bare(), CRAYONS, Confirmation(0.0, 0.0))
    assert text.startswith("Not found: its segment has 0 points")
    assert "box is off the object" in text


def test_nothing_is_diagnosed_without_a_truth_or_an_estimate() -> None:
    assert diagnosis(bare(), BOTTLE) == ""
    assert diagnosis(bare(), CRAYONS) == ""


def test_a_right_pose_is_called_right() -> None:
    assert diagnosis(example(), BOX) == "The pose is right."


def test_a_turn_that_hardly_shows_is_named() -> None:
    e = example()
    model = e.library[e.detections[BOTTLE].object_id]
    X_CO = e.estimate.objects[BOTTLE].X_CO
    assert X_CO is not None
    turned = X_CO @ lookalike_turns(model)[0]
    error = e.error(BOTTLE, turned)
    assert error is not None
    assert error.geodesic_deg > 170
    text = diagnosis(with_estimate(turned, BOTTLE), BOTTLE)
    assert text.startswith("It is turned to where the object looks nearly the same")


def test_blames_the_refinement_where_the_search_was_right() -> None:
    X_CO = example().estimate.objects[BOX].X_CO
    assert X_CO is not None
    assert "later rounds or the refinement" in diagnosis(with_estimate(X_CO @ FAR), BOX)


def test_blames_the_search_where_a_hypothesis_was_right() -> None:
    X_CO = example().estimate.objects[BOX].X_CO
    assert X_CO is not None
    text = diagnosis(replace(with_estimate(X_CO @ FAR), searches=()), BOX)
    assert "was near the true pose, but the search" in text


def test_blames_the_hypotheses_where_none_is_near() -> None:
    e = example()
    truth = [X if X is None else X @ FAR for X in e.truth]
    text = diagnosis(replace(e, truth=tuple(truth)), BOX)
    assert text.startswith("None of the kept hypotheses is near")


def test_tells_of_a_search_that_came_near_only() -> None:
    e = example()
    shift = make_pose(p=[0.0, 0.0, 0.015])
    truth = [X if X is None else X @ shift for X in e.truth]
    text = diagnosis(replace(e, truth=tuple(truth)), BOX)
    assert text.startswith("The search came near the true pose")


def test_errors_are_told_stage_by_stage() -> None:
    e = example()
    scored, nearest, searched, final = stage_errors(e, BOX)
    assert scored is not None
    assert nearest is not None
    assert searched is not None
    assert final is not None
    assert error_size(nearest) <= error_size(scored)
    first = e.error(BOX, e.scene.X_CS @ e.hypotheses[BOX].poses[0])
    last = e.error(BOX, e.estimate.objects[BOX].X_CO)
    for told, expected in ((scored, first), (final, last)):
        assert expected is not None
        np.testing.assert_array_equal(told.candidates, expected.candidates)
    assert stage_errors(bare(), CRAYONS) == [None] * 4


def test_an_unknown_error_is_within_nothing() -> None:
    assert not is_within(None, np.inf, np.inf)
