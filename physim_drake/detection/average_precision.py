# SPDX-License-Identifier: MIT
"""Mean average precision of boxes and masks, as COCO defines it (pycocotools)."""

from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as coco_mask
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from physim_drake.observation.observation import Detection


@dataclass(frozen=True)
class AveragePrecision:
    """How well objects are found, as means over the classes, 0..1.

    Attributes:
        box_50: precision of boxes that overlap the true ones by half.
        box: mean precision of boxes over overlaps from 0.5 to 0.95.
        mask_50: precision of masks that overlap the true ones by half.
        mask: mean precision of masks over overlaps from 0.5 to 0.95.
        box_50_by_object: `box_50` of each object, by its id.
        recall_50: share of the true objects that a box of any score overlaps by half.
    """

    box_50: float
    box: float
    mask_50: float
    mask: float
    box_50_by_object: dict[int, float]
    recall_50: float

    def __str__(self) -> str:
        return (
            f"boxes {self.box_50:.3f} at overlap 0.5, {self.box:.3f} at 0.5 to 0.95; "
            f"masks {self.mask_50:.3f}, {self.mask:.3f}"
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        by_object = {str(k): v for k, v in self.box_50_by_object.items()}
        return {**vars(self), "box_50_by_object": by_object}


def average_precision(
    found: Sequence[Sequence[Detection]], truth: Sequence[Sequence[Detection]]
) -> AveragePrecision:
    """Judges the detections of images.

    Args:
        found: detections of each image, with masks.
        truth: true objects of each image, with masks.
    """
    reference = _reference(truth)
    results = [
        {
            "image_id": image,
            "category_id": d.object_id,
            "bbox": _bbox(d),
            "segmentation": _encode(d),
            "score": d.score,
        }
        for image, detections in enumerate(found, start=1)
        for d in detections
    ]
    ids = sorted(category["id"] for category in reference.dataset["categories"])
    if not results or not ids:
        return AveragePrecision(0.0, 0.0, 0.0, 0.0, dict.fromkeys(ids, 0.0), 0.0)
    with redirect_stdout(io.StringIO()):
        # The stubs of pycocotools know file names only, and no plain dictionaries.
        given = reference.loadRes(results)  # pyright: ignore[reportArgumentType]
    boxes, box_recall = _evaluate(reference, given, "bbox")
    masks, _ = _evaluate(reference, given, "segm")
    by_object = {i: _mean(boxes[0, :, k]) for k, i in enumerate(ids)}
    return AveragePrecision(
        _mean(boxes[0]),
        _mean(boxes),
        _mean(masks[0]),
        _mean(masks),
        by_object,
        box_recall,
    )


def _evaluate(
    reference: COCO, given: COCO, kind: Literal["bbox", "segm"]
) -> tuple[NDArray[np.float64], float]:
    """Precision (overlaps, recalls, classes), -1 if undefined, and recall at 0.5."""
    with redirect_stdout(io.StringIO()):
        judge = COCOeval(reference, given, kind)
        judge.evaluate()
        judge.accumulate()
    precision = judge.eval["precision"][:, :, :, 0, -1]
    return precision, _mean(judge.eval["recall"][0, :, 0, -1])


def _mean(values: NDArray[np.float64]) -> float:
    defined = values[values > -1]
    return float(defined.mean()) if defined.size else 0.0


def _reference(truth: Sequence[Sequence[Detection]]) -> COCO:
    annotations: list[dict[str, Any]] = []
    for image, objects in enumerate(truth, start=1):
        for d in objects:
            bbox = _bbox(d)
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": image,
                    "category_id": d.object_id,
                    "iscrowd": 0,
                    "area": bbox[2] * bbox[3],
                    "bbox": bbox,
                    "segmentation": _encode(d),
                }
            )
    reference = COCO()
    dataset: dict[str, Any] = {
        "info": {},
        "images": [_image(k, objects) for k, objects in enumerate(truth, start=1)],
        "annotations": annotations,
        "categories": [
            {"id": i} for i in sorted({d["category_id"] for d in annotations})
        ],
    }
    reference.dataset = dataset  # pyright: ignore[reportAttributeAccessIssue]
    with redirect_stdout(io.StringIO()):
        reference.createIndex()
    return reference


def _image(number: int, objects: Sequence[Detection]) -> dict[str, int]:
    # pycocotools needs the size of every image that has a mask.
    shape = objects[0].mask.shape if objects and objects[0].mask is not None else (1, 1)
    return {"id": number, "height": shape[0], "width": shape[1]}


def _bbox(detection: Detection) -> list[float]:
    left, top, right, bottom = (float(x) for x in detection.box)
    return [left, top, right - left, bottom - top]


def _encode(detection: Detection) -> dict[str, Any]:
    assert detection.mask is not None, "masks are judged as well"
    mask = np.asfortranarray(detection.mask, dtype=np.uint8)
    return cast(dict[str, Any], coco_mask.encode(mask))
