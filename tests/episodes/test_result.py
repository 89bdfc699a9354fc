# SPDX-License-Identifier: MIT
from __future__ import annotations

import json

import numpy as np
import pytest

from physim_drake.episodes.result import (
    EpisodeResult,
    LookOutcome,
    ObjectOutcome,
    figures,
    reason_left,
    summary,
)
from physim_drake.evaluation.matching import ObjectError
from physim_drake.picking.task_state import EventKind, TaskEvent

EVENTS = (
    TaskEvent(1.0, EventKind.LOOK, "look 1"),
    TaskEvent(3.0, EventKind.PICK, "soap: quality 0.9", "soap"),
    TaskEvent(5.0, EventKind.NO_SEAL, "the cup does not seal on soap", "soap"),
    TaskEvent(6.0, EventKind.PICK, "soap: quality 0.8", "soap"),
    TaskEvent(8.0, EventKind.PLACED, "soap is let go over the tote", "soap"),
    TaskEvent(9.0, EventKind.PICK, "book: quality 0.9", "book"),
    TaskEvent(9.5, EventKind.DROPPED, "book was lost while it was lifted", "book"),
    TaskEvent(10.0, EventKind.PICK, "ball: quality 0.9", "ball"),
    TaskEvent(11.0, EventKind.PLACED, "ball is let go over the tote", "ball"),
    TaskEvent(12.0, EventKind.END, "what is left has been given up"),
)
OBJECTS = (
    ObjectOutcome("soap", 1, True),
    ObjectOutcome("book", 2, False, "lost"),
    ObjectOutcome("ball", 2, False, "fell beside the tote"),
)
LOOKS = (
    LookOutcome(
        1,
        1.0,
        (
            ObjectError("soap", 9, np.radians(1.0), 0.002, 0.9),
            ObjectError("book", 6, np.radians(3.0), 0.004, 0.8),
            ObjectError("ball", 11),
        ),
    ),
    LookOutcome(2, 8.0, (), "no surface"),
)


def result(**changes: object) -> EpisodeResult:
    values: dict[str, object] = {
        "episode": 0,
        "objects": OBJECTS,
        "looks": LOOKS,
        "events": EVENTS,
        "simulated": 12.0,
        "stages": {"simulation": 20.0, "estimation": 4.0},
    }
    return EpisodeResult(**{**values, **changes})  # type: ignore[arg-type]


def test_what_the_truth_says_decides_what_succeeded() -> None:
    figure = figures([result()])
    assert figure["objects"] == 3
    assert figure["cleared"] == 1
    assert figure["picks"] == 4
    assert figure["succeeded"] == 1  # the ball was let go, but is not in the tote
    assert figure["dropped"] == 2
    assert figure["not_sealed"] == 1


def test_times_and_errors() -> None:
    figure = figures([result()])
    assert figure["picks_per_hour"] == pytest.approx(300.0)
    assert figure["real_time_factor"] == pytest.approx(0.5)
    assert figure["median_rotation_deg"] == pytest.approx(2.0)
    assert figure["median_translation_mm"] == pytest.approx(3.0)
    assert figure["not_found"] == 1


def test_all_episodes_together() -> None:
    figure = figures([result(), result(episode=1)])
    assert figure["objects"] == 6
    assert figure["picks_per_hour"] == pytest.approx(300.0)
    assert figure["stages"] == {"simulation": 40.0, "estimation": 8.0}


def test_nothing_at_all_is_no_division_by_zero() -> None:
    figure = figures([result(events=(), looks=(), simulated=0.0, stages={})])
    assert figure["picks_per_hour"] == 0.0
    assert figure["real_time_factor"] == 0.0
    assert figure["median_rotation_deg"] is None


def test_json_has_the_figures_over_all_and_of_each_episode() -> None:
    text = json.loads(json.dumps(summary([result(), result(episode=1)])))
    keys = {"objects", "cleared", "picks", "succeeded", "dropped"}
    keys |= {"picks_per_hour", "real_time_factor"}
    assert keys <= set(text)
    assert [keys <= set(episode) for episode in text["episodes"]] == [True, True]
    episode = text["episodes"][0]
    assert episode["end"] == "what is left has been given up"
    assert [o["name"] for o in episode["left"]] == ["book", "ball"]
    assert episode["look_errors"][0]["objects"][0]["rotation_deg"] == pytest.approx(1.0)
    assert episode["look_errors"][0]["objects"][2]["rotation_deg"] is None
    assert episode["look_errors"][1]["error"] == "no surface"


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("book", "at 9.5 s: book was lost while it was lifted"),
        ("ball", "at 11.0 s it was let go, and fell beside the tote"),
        ("glue", "it was never picked; at the end: what is left has been given up"),
    ],
)
def test_every_object_that_is_left_has_a_reason(name: str, reason: str) -> None:
    assert reason_left(name, EVENTS) == reason


def test_failures_are_told_apart_from_the_rest() -> None:
    kinds = [event.kind for event in result().failures]
    assert kinds == [EventKind.NO_SEAL, EventKind.DROPPED]
