# SPDX-License-Identifier: MIT
"""What accuracy is lost where a network says where the objects are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physim_drake.evaluation.report import InstanceErrors


@dataclass(frozen=True)
class DetectorLoss:
    """How much larger mean errors are than with given detections.

    Attributes:
        rotation: share by which the mean rotation error is larger, over all objects;
            those that are not found count 90 degrees and 20 cm, in both.
        translation: the same of the translation error.
        rotation_found: the same over the objects that both found.
        translation_found: the same of the translation error.
        missed: objects that were found with given detections only.
        gained: objects that were found with the network only.
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
        given: with given detections.
        network: with those of a network, in the same order.
    """
    pairs = list(zip(given, network, strict=True))
    both = [(a, b) for a, b in pairs if a.found and b.found]
    return DetectorLoss(
        *_larger(pairs),
        *_larger(both),
        missed=sum(a.found and not b.found for a, b in pairs),
        gained=sum(b.found and not a.found for a, b in pairs),
    )


def _larger(
    pairs: Sequence[tuple[InstanceErrors, InstanceErrors]],
) -> tuple[float, float]:
    """Shares by which the second's mean errors are larger; 0 where there is none."""
    if not pairs:
        return 0.0, 0.0
    errors = np.array(
        [[[e.rotation_deg, e.translation_cm] for e in pair] for pair in pairs]
    )
    first, second = np.maximum(errors.mean(axis=0), 1e-9)
    rotation, translation = second / first - 1.0
    return float(rotation), float(translation)
