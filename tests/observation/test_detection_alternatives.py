# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace

from physim_drake.observation.detection_alternatives import rival_choices
from physim_drake.observation.observation import Detection
from tests.observation.test_detection_selection import SHAPE, seen


def choices(*detections: Detection, most: int = 3) -> list[list[float]]:
    """Where each object is, choice by choice."""
    found = rival_choices(detections, SHAPE, most)
    return [[float(d.box[0]) for d in choice] for choice in found]


def test_what_is_sure_stays() -> None:
    sure = replace(seen(1, 0.5, 0), instead=(seen(1, 0.2, 40),))
    assert choices(sure, seen(2, 0.1, 20)) == []


def test_an_unsure_object_is_tried_elsewhere_the_likeliest_first() -> None:
    places = (seen(1, 0.1, 40), seen(1, 0.3, 20), seen(1, 0.2, 60))
    unsure = replace(seen(1, 0.4, 0), instead=places)
    assert choices(unsure) == [[20], [60], [40]]
    assert choices(unsure, most=1) == [[20]]


def test_two_things_are_exchanged() -> None:
    unsure = replace(seen(1, 0.4, 0), instead=(seen(1, 0.1, 40),))
    sure = replace(seen(2, 0.9, 40), instead=(seen(2, 0.2, 1),))
    assert choices(unsure, sure) == [[40, 1]]


def test_an_object_with_nowhere_to_go_is_not_driven_out() -> None:
    unsure = replace(seen(1, 0.4, 0), instead=(seen(1, 0.1, 40),))
    third = seen(3, 0.9, 20)
    assert choices(unsure, seen(2, 0.9, 40)) == []
    to_third = replace(seen(2, 0.9, 40), instead=(seen(2, 0.2, 20),))
    assert choices(unsure, to_third, third) == []


def test_an_object_that_is_not_seen_is_no_rival() -> None:
    unsure = replace(seen(1, 0.4, 0), instead=(seen(1, 0.1, 40),))
    (choice,) = rival_choices([unsure, Detection.unseen(2, *SHAPE)], SHAPE)
    assert not choice[1].seen
