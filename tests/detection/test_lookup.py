# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physim_drake import batch
from physim_drake.batch import Target, detection_lookup, match_detections
from physim_drake.datasets.bop import BopDataset
from physim_drake.detection import lookup
from physim_drake.detection.detector import NetworkDetector
from physim_drake.errors import InputError
from physim_drake.observation import Detection
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


def sees(monkeypatch: pytest.MonkeyPatch, *ids: int) -> None:
    """Makes the network see these objects, twice each."""

    def detect(*arguments: object) -> tuple[Detection, ...]:
        mask = np.ones((HEIGHT, WIDTH), dtype=bool)
        box = np.array([1.0, 2.0, 3.0, 4.0])
        return tuple(Detection(i, box, s, mask) for s in (0.9, 0.4) for i in ids)

    monkeypatch.setattr(NetworkDetector, "detect", detect)


def test_targets_get_the_best_detection(
    dataset: BopDataset, weights: Path, monkeypatch: pytest.MonkeyPatch
):
    sees(monkeypatch, 1, 2)
    look_up, source = detection_lookup(dataset, weights=weights)
    found = match_detections(TARGETS, IMAGE, look_up(IMAGE), source)
    assert [(d.object_id, d.score) for d in found] == [(1, 0.9), (2, 0.9)]
    assert source == str(weights)


def test_an_object_that_is_not_seen_has_no_pixel(
    dataset: BopDataset, weights: Path, monkeypatch: pytest.MonkeyPatch
):
    sees(monkeypatch, 2)
    look_up, source = lookup.network_lookup(dataset, weights)
    missed, seen = match_detections(TARGETS, IMAGE, look_up(IMAGE), source)
    assert seen.score == 0.9
    assert missed.object_id == 1
    assert missed.mask is not None
    assert not missed.mask.any()
    assert missed.box.tolist() == seen.box.tolist()


def test_where_nothing_is_seen_the_surface_is_looked_for_everywhere(
    dataset: BopDataset, weights: Path, monkeypatch: pytest.MonkeyPatch
):
    sees(monkeypatch)
    look_up, _ = lookup.network_lookup(dataset, weights)
    for d in look_up(IMAGE):
        assert d.box.tolist() == [0, 0, WIDTH, HEIGHT]


def test_the_network_stands_in_for_missing_detections(
    dataset: BopDataset, weights: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(batch, "DETECTOR", weights)
    _, source = detection_lookup(dataset)
    assert source == str(weights)
    own = dataset.root / "detections.json"
    own.write_text(
        '[{"scene_id": 3, "image_id": 0, "category_id": 1, "bbox": [1, 1, 2, 2], '
        '"score": 1.0}]'
    )
    assert detection_lookup(dataset)[1] == str(own)


def test_without_a_network_detections_are_asked_for(
    dataset: BopDataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(batch, "DETECTOR", tmp_path / "none")
    with pytest.raises(InputError, match="give --detections FILE"):
        detection_lookup(dataset)


def test_two_sources_are_refused(dataset: BopDataset, weights: Path):
    with pytest.raises(InputError, match="--masks: given together with --weights"):
        detection_lookup(dataset, masks=True, weights=weights)


def test_weights_for_other_objects(dataset: BopDataset, tmp_path: Path):
    other = write_weights(tmp_path / "other", 1, 7)
    with pytest.raises(InputError, match=r"object 2 of .* is not among 1, 7"):
        detection_lookup(dataset, weights=other)


def test_images_without_colour(dataset: BopDataset, weights: Path):
    (dataset.root / "test/000003/rgb").rename(dataset.root / "lost")
    look_up, _ = detection_lookup(dataset, weights=weights)
    with pytest.raises(InputError, match="has no colour"):
        look_up(IMAGE)
