# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from pycocotools import mask as coco

from physim_drake.batch.detection_source import DetectionSource
from physim_drake.datasets.bop import BopDataset, Target
from physim_drake.datasets.detections import load_detections, warn_of_left_out
from physim_drake.datasets.rle import decode_runs, read_runs
from physim_drake.errors import InputError, PhysimError
from physim_drake.storage.json_nodes import JsonNode
from tests.datasets.tiny import (
    HEIGHT,
    WIDTH,
    detection,
    mangled,
    mask_image,
    write_json,
    write_tiny,
)

COUNTS = [WIDTH * HEIGHT - 5, 5]


@pytest.fixture
def dataset(tmp_path: Path) -> BopDataset:
    return BopDataset(write_tiny(tmp_path / "tiny"))


def load(dataset: BopDataset, *entries: dict[str, Any]) -> Any:
    path = dataset.root / "detections.json"
    write_json(path, list(entries))
    return load_detections(path, dataset)


def packed(mask: np.ndarray) -> dict[str, Any]:
    rle = coco.encode(np.asfortranarray(mask.astype(np.uint8)))
    return {"size": rle["size"], "counts": rle["counts"].decode()}


def test_boxes_by_image(dataset: BopDataset) -> None:
    detections = load(
        dataset, detection(), detection(image_id=7), detection(category_id=2)
    )
    assert list(detections) == [(3, 0), (3, 7)]
    assert [d.object_id for d in detections[3, 0]] == [1, 2]
    assert detections[3, 0][0].box.tolist() == [1, 2, 4, 5]
    assert detections[3, 0][0].mask is None
    assert detections.get((3, 1)) is None


def test_both_encodings_of_a_mask(dataset: BopDataset) -> None:
    mask = mask_image(1, 4) > 0
    plain = {"size": [HEIGHT, WIDTH], "counts": [10, 3, 5, 3, 5, 3, 67]}
    for segmentation in (packed(mask), plain):
        (found,) = load(dataset, detection(segmentation=segmentation))[3, 0]
        assert (found.mask == mask).all()


@given(mask=arrays(bool, array_shapes(min_dims=2, max_dims=2, max_side=40)))
def test_packed_masks_decode_as_pycocotools_encodes_them(mask: np.ndarray) -> None:
    height, width = mask.shape
    runs = read_runs(JsonNode(packed(mask), Path("x")), width, height)
    assert (decode_runs(runs, width, height) == mask).all()


@given(text=st.text(st.characters(min_codepoint=40, max_codepoint=120), max_size=12))
def test_any_string_is_a_mask_or_an_input_error(text: str) -> None:
    node = JsonNode({"size": [4, 6], "counts": text}, Path("x"))
    with suppress(PhysimError):
        runs = read_runs(node, 6, 4)
        assert decode_runs(runs, 6, 4).shape == (4, 6)


def test_a_missing_image_is_an_error_when_its_turn_comes(dataset: BopDataset) -> None:
    path = dataset.root / "test" / "000003" / "depth" / "000007.png"
    path.unlink()
    detections = load(dataset, detection(), detection(image_id=7), detection())
    assert len(detections[3, 0]) == 2
    with pytest.raises(InputError, match=r"000007\.png: cannot be read"):
        detections[3, 7]


def test_detections_of_other_images_are_skipped(dataset: BopDataset) -> None:
    other = detection(scene_id=4, segmentation={"size": [1, 1], "counts": [1]})
    assert list(load(dataset, other, detection())) == [(3, 0)]
    with pytest.raises(InputError, match="holds no detection of an image"):
        load(dataset, other)


def size(height: int, width: int, counts: object = COUNTS) -> dict[str, Any]:
    return {"size": [height, width], "counts": counts}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"bbox": [0, 0, -1, 5]}, r"\[0\].bbox: has width -1"),
        ({"bbox": [0, 0, 1]}, "list of 4"),
        ({"bbox": [0, 0, 1, None]}, "4 finite numbers"),
        ({"bbox": [0, 0, 1e300, 1]}, "in pixels"),
        ({"score": "high"}, "score: is 'high'"),
        ({"category_id": -1}, "category_id: is -1"),
        ({"scene_id": 3.5}, "scene_id: is 3.5"),
        ({"segmentation": [[1, 2, 3]]}, "must be an object"),
        ({"segmentation": size(WIDTH, HEIGHT)}, r"is \[12, 8\]"),
        ({"segmentation": size(HEIGHT, WIDTH, [1, 2])}, "sums to 3 pixels"),
        ({"segmentation": size(HEIGHT, WIDTH, [-1, 97])}, "counts\\[0\\]: is -1"),
        ({"segmentation": size(HEIGHT, WIDTH, "")}, "ends within a run"),
        ({"segmentation": size(HEIGHT, WIDTH, "oooooooo0")}, "too long"),
        ({"segmentation": size(HEIGHT, WIDTH, "5é")}, "outside"),
        ({"segmentation": size(HEIGHT, WIDTH, 5)}, "must be a list"),
    ],
)
def test_bad_entries_name_their_field(
    dataset: BopDataset, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        load(dataset, detection(**changes))


@settings(
    max_examples=150,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_mangled_files_raise_only_input_errors(
    dataset: BopDataset, data: st.DataObject
) -> None:
    entries = [
        detection(segmentation=packed(mask_image(1, 4))),
        detection(segmentation=size(HEIGHT, WIDTH)),
    ]
    path = dataset.root / "detections.json"
    path.write_bytes(data.draw(mangled(json.dumps(entries).encode())))
    with suppress(PhysimError):
        for found in load_detections(path, dataset).values():
            assert len(found) > 0


TARGETS = [Target(3, 0, 1, 1), Target(3, 7, 1, 1), Target(3, 7, 2, 1)]


def test_detections_that_are_left_out_are_told_once(
    dataset: BopDataset, caplog: pytest.LogCaptureFixture
) -> None:
    found = load(
        dataset,
        detection(),
        detection(category_id=2),
        detection(category_id=9),
        detection(category_id=9, image_id=7),
    )
    warn_of_left_out(found, TARGETS, "boxes.json")
    (said,) = caplog.messages
    assert said == (
        "boxes.json: detections left out, since their objects are not targets of the "
        "image: 3 (obj_id 2, 9)"
    )
    caplog.clear()
    warn_of_left_out(found, [Target(3, 7, 9, 1)], "boxes.json")
    assert caplog.messages == []


def test_few_of_many_objects_left_out_are_named(
    dataset: BopDataset, caplog: pytest.LogCaptureFixture
) -> None:
    found = load(dataset, *[detection(category_id=k) for k in range(1, 31)])
    warn_of_left_out(found, TARGETS, "boxes.json")
    (said,) = caplog.messages
    assert said.endswith("(obj_id 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, ...)")


def test_the_look_up_tells_what_the_targets_leave_out(
    dataset: BopDataset, caplog: pytest.LogCaptureFixture
) -> None:
    load(dataset, detection(), detection(category_id=9))
    DetectionSource.default(dataset, TARGETS)
    assert "not targets of the image: 1 (obj_id 9)" in caplog.text
    caplog.clear()
    DetectionSource.default(dataset)
    assert caplog.messages == []


def test_a_detection_may_lack_score_and_have_an_empty_segmentation(
    dataset: BopDataset,
) -> None:
    entry = detection(segmentation=[])
    entry.pop("score", None)
    (found,) = load(dataset, entry)[3, 0]
    assert found.score == 1.0
    assert found.mask is None
