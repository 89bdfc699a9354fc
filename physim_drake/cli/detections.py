# SPDX-License-Identifier: MIT
"""The detections that `--detections`, `--masks` and `--weights` ask for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from physim_drake.batch.detection_source import DetectionSource
from physim_drake.datasets.bop import BopDataset, Target
from physim_drake.errors import InputError
from physim_drake.estimation.config import Method

_REMEDY = (
    "give --detections FILE (boxes in BOP's JSON format), --weights FILE of a network "
    "that was trained with these models, or --masks to use the dataset's mask_visib"
)


def detection_source(
    dataset: BopDataset,
    detections: Path | None = None,
    masks: bool = False,
    weights: Path | None = None,
    targets: Sequence[Target] | None = None,
) -> DetectionSource:
    """The source that the options choose, or the default one if they choose none.

    Args:
        dataset: the images.
        detections: value of `--detections`.
        masks: value of `--masks`.
        weights: value of `--weights`.
        targets: objects to look for; by default the dataset's own.

    Raises:
        InputError: if more than one source is given, or the source cannot be used.
    """
    given = {"--detections": detections, "--masks": masks or None, "--weights": weights}
    named = [name for name, value in given.items() if value is not None]
    if len(named) > 1:
        raise InputError(
            named[0], f"given together with {named[1]}", "give one of the two"
        )
    if masks:
        return DetectionSource.masks(dataset)
    if weights is not None:
        return DetectionSource.network(dataset, weights, targets)
    if detections is not None:
        return DetectionSource.file(dataset, detections, targets)
    return DetectionSource.default(dataset, targets, remedy=_REMEDY)


def detection_source_for(
    method: Method,
    dataset: BopDataset,
    detections: Path | None,
    masks: bool,
    weights: Path | None,
    targets: Sequence[Target],
) -> DetectionSource:
    """As `detection_source`, but fcn-pca-icp takes what its network segments.

    Raises:
        InputError: as `detection_source`; or if other detections are given for
            fcn-pca-icp.
    """
    if method is not Method.FCN_PCA_ICP:
        return detection_source(dataset, detections, masks, weights, targets)
    if detections is not None or masks:
        raise InputError(
            "--masks" if masks else "--detections",
            f"given with {method}, which segments images by a network",
            "leave it out, or give --method pca-icp",
        )
    return DetectionSource.network(dataset, weights, targets, pixels=True)
