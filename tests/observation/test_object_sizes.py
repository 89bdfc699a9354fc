# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace

import pytest

from physim_drake.observation.object_sizes import ObjectSizes
from tests.synthetic import SOAP, library, stack, synthesize


@pytest.mark.parametrize(
    ("diameters", "factor"),
    [
        ((0.05, 0.30), 1.0),
        ((0.015,), 0.25),
        ((0.80,), 2.0),
        ((1.45,), 4.0),
        ((0.015, 0.80), 0.25),
        ((0.10, 0.80), 2.0),
        ((), 1.0),
    ],
)
def test_lengths_follow_the_objects_by_powers_of_two(
    diameters: tuple[float, ...], factor: float
) -> None:
    assert ObjectSizes(dict(enumerate(diameters))).factor == factor


def test_objects_are_as_far_away_as_measured() -> None:
    made = synthesize(stack())
    sizes = ObjectSizes.of(made.detections, library())
    distance = sizes.distance(made.observation, made.detections)
    assert distance == pytest.approx(0.68, abs=0.08)


def test_a_depth_image_of_a_wrong_unit_does_not_make_objects_far() -> None:
    made = synthesize(stack())
    sizes = ObjectSizes.of(made.detections, library())
    wrong = replace(made.observation, depth=made.observation.depth * 10)
    assert sizes.distance(wrong, made.detections) < 2


def test_thickness_is_the_least_extent() -> None:
    sizes = ObjectSizes.of(synthesize(stack()).detections, library())
    assert sizes.thicknesses[SOAP] == pytest.approx(library()[SOAP].extents.min())
