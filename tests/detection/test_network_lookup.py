# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physim_drake.batch.detection_source import match_detections
from physim_drake.datasets.bop import BopDataset, Target
from physim_drake.detection import network_lookup as lookup
from physim_drake.detection.detector import NetworkDetector
from physim_drake.observation.observation import Detection
from tests.cli.test_detect import write_weights
from tests.datasets.tiny import HEIGHT, WIDTH, write_tiny

IMAGE = (3, 0)
TARGETS = [Target(*IMAGE, object_id, 1) for object_id in (1, 2)]


@pytest.fixture
def dataset(tmp_path: Path) -> BopDataset:
    return BopDataset(write_tiny(tmp_path / "tiny"))


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    return write_weights(tmp_path / "weights", 1, 2)


def sees(
    monkeypatch: pytest.MonkeyPatch, *ids: int, scores: tuple[float, ...] = (0.9, 0.4)
) -> None:
    """Makes the network see these objects at different places, for each score."""

    def detect(*arguments: object) -> tuple[Detection, ...]:
        box = np.array([1.0, 2.0, 3.0, 4.0])
        found = []
        for score in scores:
            for object_id in ids:
                mask = np.zeros((HEIGHT, WIDTH), dtype=bool)
                mask[len(found)] = True
                found.append(Detection(object_id, box, score, mask))
        return tuple(found)

    monkeypatch.setattr(NetworkDetector, "detect", detect)


def test_an_object_that_is_not_seen_has_no_pixel(
    dataset: BopDataset, weights: Path, monkeypatch: pytest.MonkeyPatch
):
    sees(monkeypatch, 2)
    look_up, _ = lookup.network_lookup(dataset, weights)
    missed, seen = match_detections(TARGETS, IMAGE, look_up(IMAGE), dataset)
    assert (seen.score, seen.seen) == (0.9, True)
    assert (missed.object_id, missed.seen) == (1, False)
    assert missed.mask is not None
    assert not missed.mask.any()


def test_instances_that_are_not_seen_are_said_one_by_one(
    dataset: BopDataset, weights: Path, monkeypatch: pytest.MonkeyPatch
):
    sees(monkeypatch, 1)
    targets = [Target(*IMAGE, 1, 4), Target(*IMAGE, 2, 3)]
    look_up, _ = lookup.network_lookup(dataset, weights, targets)
    found = match_detections(targets, IMAGE, look_up(IMAGE), dataset)
    assert [d.object_id for d in found] == [1] * 4 + [2] * 3
    assert [d.score for d in found] == [0.9, 0.4, 0, 0, 0, 0, 0]


def test_what_is_no_target_is_not_looked_for(
    dataset: BopDataset, weights: Path, monkeypatch: pytest.MonkeyPatch
):
    sees(monkeypatch, 1, 2)
    look_up, _ = lookup.network_lookup(dataset, weights, TARGETS[1:])
    assert {d.object_id for d in look_up(IMAGE)} == {2}
    found = match_detections(TARGETS[1:], IMAGE, look_up(IMAGE), dataset)
    assert [d.object_id for d in found] == [2]
