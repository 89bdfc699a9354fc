# SPDX-License-Identifier: MIT
"""Alternatives of detections, with an estimator that knows how much is explained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from physim_drake.estimation.alternatives import best_alternative
from physim_drake.estimation.config import EstimationConfig, Method
from physim_drake.observation.observation import Detection
from physim_drake.observation.support_surface import SupportSurface
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from tests.observation.test_detection_selection import SHAPE, seen

Places = tuple[float, ...]
"""The left edge of each object's box."""


class Table:
    """An estimator whose confidences stand in a table; notes what is asked."""

    def __init__(self, confidences: Mapping[Places, Sequence[float]]) -> None:
        self._confidences = confidences
        self.asked: list[Places] = []

    def __call__(self, detections: Sequence[Detection]) -> SceneEstimate:
        places = tuple(float(d.box[0]) for d in detections)
        self.asked.append(places)
        objects = tuple(
            ObjectEstimate(d.object_id, "", np.eye(4), np.eye(4), confidence, "")
            for d, confidence in zip(detections, self._confidences[places], strict=True)
        )
        surface = SupportSurface(np.eye(4), np.eye(4))
        stages = {"search": 1.0, f"stage {len(self.asked)}": 2.0}
        return SceneEstimate(objects, surface, "", stages, (), tuple(detections))


def unsure(*instead: float) -> Detection:
    """An object at 0 that may be elsewhere, the first place being the likeliest."""
    places = (seen(1, 0.3 - 0.01 * n, int(x)) for n, x in enumerate(instead))
    return replace(seen(1, 0.4, 0), instead=tuple(places))


def best(table: Table, *detections: Detection, config: EstimationConfig) -> Places:
    estimate = best_alternative(table, detections, SHAPE, config)
    return tuple(float(d.box[0]) for d in estimate.detections)


CONFIG = EstimationConfig()


def test_what_the_image_confirms_most_is_taken() -> None:
    table = Table({(0,): [0.2], (20,): [0.9], (40,): [0.6]})
    assert best(table, unsure(20, 40), config=CONFIG) == (20,)
    assert table.asked == [(0,), (20,), (40,)]


def test_nothing_is_tried_once_the_image_is_sure() -> None:
    table = Table({(0,): [0.98]})
    assert best(table, unsure(20), config=CONFIG) == (0,)
    table = Table({(0,): [0.2], (20,): [0.98]})
    assert best(table, unsure(20, 40), config=CONFIG) == (20,)
    assert table.asked == [(0,), (20,)]


@pytest.mark.parametrize("method", [m for m in Method if not m.searches])
def test_methods_that_do_not_search_try_nothing(method: Method) -> None:
    table = Table({(0,): [0.2]})
    assert best(table, unsure(20), config=replace(CONFIG, method=method)) == (0,)


@pytest.mark.parametrize(("confidence", "taken"), [(0.92, 0.0), (0.93, 20.0)])
def test_an_object_that_the_detector_missed_must_be_confirmed(
    confidence: float, taken: float
) -> None:
    missed = replace(Detection.unseen(1, *SHAPE), instead=(seen(1, 0.3, 20),))
    nowhere = float(missed.box[0])
    table = Table({(nowhere,): [0.0], (20,): [confidence]})
    assert best(table, missed, config=CONFIG) == (taken or nowhere,)


def test_the_seconds_of_all_attempts_count() -> None:
    table = Table({(0,): [0.9], (20,): [0.2]})
    estimate = best_alternative(table, [unsure(20)], SHAPE, CONFIG)
    assert estimate.stages == {"search": 2.0, "stage 1": 2.0, "stage 2": 2.0}
