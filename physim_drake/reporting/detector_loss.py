# SPDX-License-Identifier: MIT
"""Accuracy that is lost if a network detects the objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physim_drake.evaluation.report import InstanceErrors


@dataclass(frozen=True)
class DetectorLoss:
    """How much larger mean errors are than with given detections.

    Attributes:
        rotation: increase of the mean rotation error over all objects, as a share;
            objects that are not found count 90 degrees and 20 cm.
        translation: increase of the mean translation error, likewise.
        rotation_found: increase of the rotation error over objects that both found.
        translation_found: increase of the translation error over the same objects.
        missed: number of objects that were found only with given detections.
        gained: number of objects that were found only with the network.
    """

    rotation: float
    translation: float
    rotation_found: float
    translation_found: float
    missed: int
    gained: int


def detector_loss(
    given: Sequence[InstanceErrors], network: Sequence[InstanceErrors]
) -> DetectorLoss:
    """Compares the errors of one method on the same targets.

    Args:
        given: errors with given detections.
        network: errors with a network's detections, in the same order.
    """
    pairs = list(zip(given, network, strict=True))
    both = [(a, b) for a, b in pairs if a.found and b.found]
    return DetectorLoss(
        *_increase(pairs),
        *_increase(both),
        missed=sum(a.found and not b.found for a, b in pairs),
        gained=sum(b.found and not a.found for a, b in pairs),
    )


def _increase(
    pairs: Sequence[tuple[InstanceErrors, InstanceErrors]],
) -> tuple[float, float]:
    """Increase of both mean errors as a share; 0 if there are no pairs."""
    if not pairs:
        return 0.0, 0.0
    errors = np.array(
        [[[e.rotation_deg, e.translation_cm] for e in pair] for pair in pairs]
    )
    first, second = np.maximum(errors.mean(axis=0), 1e-9)
    rotation, translation = second / first - 1.0
    return float(rotation), float(translation)
