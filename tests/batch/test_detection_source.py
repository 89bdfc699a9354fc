# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path

import pytest

from physim_drake.batch import detection_source as batch
from physim_drake.batch.detection_source import DetectionSource, match_detections
from physim_drake.cli.detections import detection_source
from physim_drake.datasets.bop import BopDataset
from physim_drake.errors import InputError
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary
from tests.cli.test_detect import write_weights
from tests.datasets.tiny import write_tiny
from tests.detection.test_network_lookup import IMAGE, TARGETS, sees


@pytest.fixture
def dataset(tmp_path: Path) -> BopDataset:
    return BopDataset(write_tiny(tmp_path / "tiny"))


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    return write_weights(tmp_path / "weights", 1, 2)


def test_targets_get_the_best_detection(
    dataset: BopDataset, weights: Path, monkeypatch: pytest.MonkeyPatch
):
    sees(monkeypatch, 1, 2)
    source = DetectionSource.network(dataset, weights)
    found = match_detections(TARGETS, IMAGE, source.look_up(IMAGE), dataset)
    assert [(d.object_id, d.score) for d in found] == [(1, 0.9), (2, 0.9)]
    assert source.name == str(weights)


def test_the_network_stands_in_for_missing_detections(
    dataset: BopDataset, weights: Path, monkeypatch: pytest.MonkeyPatch
):
    name_models(dataset.root, "object 1", "object 2")
    monkeypatch.setattr(batch, "DETECTOR", weights)
    assert DetectionSource.default(dataset).name == str(weights)
    own = dataset.root / "detections.json"
    own.write_text(
        '[{"scene_id": 3, "image_id": 0, "category_id": 1, "bbox": [1, 1, 2, 2], '
        '"score": 1.0}]'
    )
    assert DetectionSource.default(dataset).name == str(own)


def test_only_boxes_may_be_kept(
    dataset: BopDataset, weights: Path, monkeypatch: pytest.MonkeyPatch
):
    sees(monkeypatch, 2)
    source = DetectionSource.network(dataset, weights).boxes_only()
    assert source.name == f"boxes of {weights}"
    kept = source.look_up(IMAGE)
    assert [(d.object_id, d.seen, d.mask is None) for d in kept] == [
        (1, False, False),
        (2, True, True),
    ]


def name_models(root: Path, *names: str) -> None:
    """Says what the dataset's objects are."""
    (root / "models").mkdir()
    entries = "".join(
        f"- {{id: {k}, name: {name}, mesh: a.obj}}\n"
        for k, name in enumerate(names, start=1)
    )
    (root / "models" / "library.yaml").write_text(f"objects:\n{entries}")


def test_objects_of_another_name_are_not_left_to_the_default(
    dataset: BopDataset, weights: Path, monkeypatch: pytest.MonkeyPatch
):
    name_models(dataset.root, "object 1", "teapot")
    monkeypatch.setattr(batch, "DETECTOR", weights)
    with pytest.raises(InputError, match=r"object 2 of .* is teapot"):
        DetectionSource.default(dataset)


@pytest.mark.parametrize("scale", [1.0, 1.3])
def test_objects_without_a_name_are_told_by_their_size(
    dataset: BopDataset, weights: Path, scale: float, monkeypatch: pytest.MonkeyPatch
):
    models = dataset.root / "models"
    models.mkdir()
    library = ObjectLibrary.load(APC11, {1, 2})
    for object_id, model in library.items():
        mesh = model.mesh.copy().apply_scale(1000 * scale)
        mesh.export(models / f"obj_{object_id:06d}.ply")
    monkeypatch.setattr(batch, "DETECTOR", weights)
    if scale == 1.0:
        assert DetectionSource.default(dataset).name == str(weights)
        return
    with pytest.raises(InputError, match="object 1 is not the one that"):
        DetectionSource.default(dataset)


def test_segments_come_from_the_detector_as_well(
    dataset: BopDataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    name_models(dataset.root, "object 1", "object 2")
    detector = write_weights(tmp_path / "detector", 1, 2)
    monkeypatch.setattr(batch, "DETECTOR", detector)
    source = DetectionSource.network(dataset, pixels=True)
    assert source.name == str(detector)
    found = [d for d in source.look_up(IMAGE) if d.seen]
    assert len({d.object_id for d in found}) == len(found)


def test_without_a_network_detections_are_asked_for(
    dataset: BopDataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(batch, "DETECTOR", tmp_path / "none")
    with pytest.raises(InputError, match="give detections in this file or in another"):
        DetectionSource.default(dataset)
    with pytest.raises(InputError, match="give --detections FILE"):
        detection_source(dataset)


def test_two_sources_are_refused(dataset: BopDataset, weights: Path):
    with pytest.raises(InputError, match="--masks: given together with --weights"):
        detection_source(dataset, masks=True, weights=weights)


def test_weights_for_other_objects(dataset: BopDataset, tmp_path: Path):
    other = write_weights(tmp_path / "other", 1, 7)
    with pytest.raises(InputError, match=r"object 2 of .* is not among 1, 7"):
        DetectionSource.network(dataset, other)


def test_images_without_colour(dataset: BopDataset, weights: Path):
    (dataset.root / "test/000003/rgb").rename(dataset.root / "lost")
    source = DetectionSource.network(dataset, weights)
    with pytest.raises(InputError, match="has no colour"):
        source.look_up(IMAGE)
