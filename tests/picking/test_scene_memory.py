# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace

from physim_drake.picking.scene_memory import (
    NOTHING_KNOWN,
    described,
    merged,
    on_table,
    without_object,
)
from physim_drake.poses import Array, make_pose
from physim_drake.scene_estimate import ObjectEstimate
from tests.picking.scenes import estimate_of
from tests.synthetic import ERASER, SOAP, library

HERE, THERE = make_pose(p=[0.0, 0.0, 0.02]), make_pose(p=[0.3, 0.0, 0.02])
UNSEEN = ObjectEstimate(SOAP, "soap", None, None, 0.0, "hidden")


def beyond(p_W: Array) -> bool:
    return bool(p_W[0] > 0.2)


def test_the_surer_of_two_estimates_is_kept() -> None:
    early, late = estimate_of([(SOAP, HERE)], (0.9,)), estimate_of([(SOAP, HERE)])
    doubtful = replace(late, objects=(replace(late.objects[0], confidence=0.2),))
    assert merged(early, doubtful).objects[0].confidence == 0.9
    assert merged(doubtful, early).objects[0].confidence == 0.9


def test_what_the_newest_look_misses_stays_known() -> None:
    both = merged(estimate_of([(SOAP, HERE)]), estimate_of([(ERASER, THERE)]))
    assert [o.object_id for o in both.objects] == [ERASER, SOAP]


def test_what_was_never_found_is_not_kept() -> None:
    early = replace(NOTHING_KNOWN, objects=(UNSEEN,))
    assert merged(early, estimate_of([(ERASER, HERE)])).objects[0].object_id == ERASER
    assert len(merged(early, estimate_of([(ERASER, HERE)])).objects) == 1


def test_the_first_look_is_all_that_is_known() -> None:
    first = estimate_of([(SOAP, HERE)])
    assert merged(None, first) is first


def test_of_two_alike_the_nearest_are_matched() -> None:
    early = estimate_of([(SOAP, HERE), (SOAP, THERE)], (0.9, 0.3))
    late = estimate_of([(SOAP, THERE), (SOAP, HERE)], (0.6, 0.6))
    both = merged(early, late)
    assert [o.confidence for o in both.objects] == [0.6, 0.9]


def test_a_third_one_far_from_both_is_added() -> None:
    early = estimate_of([(SOAP, make_pose(p=[0.0, 0.3, 0.02]))])
    late = estimate_of([(SOAP, THERE), (SOAP, HERE)])
    assert len(merged(early, late).objects) == 3


def test_what_is_in_the_tote_is_left_out() -> None:
    estimate = estimate_of([(SOAP, HERE), (ERASER, THERE)])
    left = on_table(estimate, library(), beyond, ())
    assert [o.object_id for o in left.objects] == [SOAP]


def test_what_was_placed_and_is_not_found_is_in_the_tote() -> None:
    estimate = replace(NOTHING_KNOWN, objects=(UNSEEN,))
    assert on_table(estimate, library(), beyond, ()).objects == (UNSEEN,)
    assert on_table(estimate, library(), beyond, {SOAP}).objects == ()


def test_one_object_can_be_taken_out() -> None:
    estimate = estimate_of([(SOAP, HERE), (ERASER, THERE)])
    assert [o.object_id for o in without_object(estimate, 0).objects] == [ERASER]


def test_an_estimate_is_described_in_a_line() -> None:
    estimate = estimate_of([(ERASER, HERE)], (0.87,))
    text = described(replace(estimate, objects=(*estimate.objects, UNSEEN)))
    assert text == f"{library()[ERASER].name} 0.87, soap not found (hidden)"
    assert described(NOTHING_KNOWN) == "nothing is seen on the table"
