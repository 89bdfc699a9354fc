# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np

from physim_drake.observation.detection_selection import (
    ChoiceConfig,
    assign_detections,
    choose_detections,
    one_for_each_thing,
)
from physim_drake.observation.observation import Detection

SHAPE = (60, 80)
ANY = {1: 2, 2: 1}


def seen(object_id: int, score: float, left: int, side: int = 20) -> Detection:
    """A square at the top of the image."""
    mask = np.zeros(SHAPE, dtype=bool)
    mask[:side, left : left + side] = True
    return Detection(object_id, np.array([left, 0.0, left + side, side]), score, mask)


def chosen(*found: Detection, config: ChoiceConfig | None = None) -> list[float]:
    result = choose_detections(found, ANY, SHAPE, config or ChoiceConfig())
    return [d.score for d in result]


def test_the_surest_of_each_object_are_kept_as_many_as_there_are() -> None:
    assert chosen(seen(1, 0.6, 0), seen(1, 0.9, 20), seen(1, 0.7, 40)) == [0.9, 0.7]
    assert chosen(seen(2, 0.6, 0), seen(2, 0.9, 20)) == [0.9]


def test_what_is_not_there_or_not_sure_or_small_is_dropped() -> None:
    assert chosen(seen(3, 0.9, 0), seen(1, 0.4, 20), seen(2, 0.8, 40, side=9)) == []
    lax = ChoiceConfig(least_score=0.4, min_pixels=81)
    assert chosen(seen(1, 0.4, 20), seen(2, 0.8, 40, side=9), config=lax) == [0.8, 0.4]


def test_one_thing_is_not_two_objects() -> None:
    assert chosen(seen(1, 0.6, 0), seen(2, 0.8, 2)) == [0.8]
    assert chosen(seen(1, 0.6, 0), seen(2, 0.8, 10)) == [0.8, 0.6]


def test_a_detection_that_is_dropped_stands_in_nobodys_way() -> None:
    assert chosen(seen(2, 0.9, 40), seen(2, 0.8, 0), seen(1, 0.7, 1)) == [0.9, 0.7]


def test_detections_may_be_boxes() -> None:
    found = Detection(1, np.array([0.0, 0.0, 20.0, 20.0]), 0.9)
    assert chosen(found, seen(2, 0.8, 1)) == [0.9]


def assigned(counts: dict[int, int], *found: Detection) -> list[tuple[int, float]]:
    result = assign_detections(found, counts, SHAPE)
    return [(d.object_id, float(d.box[0])) for d in result if d.seen]


def test_a_thing_goes_to_the_object_that_has_no_better() -> None:
    both = seen(1, 0.99, 0), seen(1, 0.9, 40), seen(2, 0.1, 2)
    assert assigned({1: 1, 2: 1}, *both) == [(1, 40), (2, 0)]
    assert assigned({1: 1}, *both) == [(1, 0)]
    assert assigned({1: 2}, *both) == [(1, 0), (1, 40)]


def test_what_the_network_does_not_see_in_a_thing_is_not_put_there() -> None:
    first, other = seen(1, 0.9, 0), seen(3, 0.9, 40)
    assert assigned({1: 1, 2: 1}, first, other) == [(1, 0)]
    assert assigned({1: 1, 2: 1}, first, other, seen(2, 0.06, 40)) == [(1, 0), (2, 40)]


def test_what_lies_within_a_surer_thing_is_no_thing_of_its_own() -> None:
    whole, part = seen(1, 0.9, 0), seen(2, 0.8, 4, side=8)
    assert assigned({1: 1, 2: 1}, whole, part) == [(1, 0)]
    assert assigned({2: 1}, whole, part) == [(2, 0)]


def test_a_detection_knows_where_else_its_object_is_seen() -> None:
    others = seen(1, 0.2, 40), seen(1, 0.3, 60), seen(1, 0.02, 20), seen(2, 0.4, 20)
    (found,) = assign_detections([seen(1, 0.9, 0), *others], {1: 1}, SHAPE)
    assert [d.score for d in found.instead] == [0.3, 0.2]


def test_what_is_not_seen_may_be_a_thing_that_nobody_claims() -> None:
    things = seen(1, 0.9, 0), seen(3, 0.8, 40), seen(4, 0.3, 60)
    first, missed = assign_detections(things, {1: 1, 2: 1}, SHAPE)
    assert first.instead == ()
    assert not missed.seen
    (place,) = missed.instead
    assert (place.object_id, place.box[0]) == (2, 40)
    assert 0 < place.score < 0.5


def test_nothing_is_assigned_where_nothing_is_seen() -> None:
    assert assigned({1: 2, 2: 1}) == []
    assert assigned({}, seen(1, 0.9, 0)) == []
    assert assigned({1: 1}, seen(1, 0.9, 0, side=0)) == []


def test_overlapping_masks_of_an_object_are_one_thing_and_the_surest_is_kept() -> None:
    left = np.zeros((20, 40), bool)
    left[5:15, 5:15] = True
    part = left.copy()
    part[:, :6] = False
    right = np.roll(left, 15, axis=1)
    box = np.array([5.0, 5.0, 15.0, 15.0])
    found = [
        Detection(1, box, 0.7, right),
        Detection(1, box, 0.8, part),
        Detection(1, box, 0.9, left),
    ]
    assert [d.score for d in one_for_each_thing(found)] == [0.9, 0.7]


def test_boxes_that_mostly_coincide_are_one_thing() -> None:
    found = [
        Detection(1, [0, 0, 10, 10], 0.9),
        Detection(1, [0, 0, 10, 9], 0.8),
        Detection(1, [0, 5, 10, 15], 0.7),
    ]
    assert [d.score for d in one_for_each_thing(found)] == [0.9, 0.7]
