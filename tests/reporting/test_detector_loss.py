# SPDX-License-Identifier: MIT
from __future__ import annotations

import pytest

from physim_drake.evaluation.report import InstanceErrors
from physim_drake.reporting.detector_loss import detector_loss


def found(rotation: float, translation: float) -> InstanceErrors:
    return InstanceErrors(
        1, 0, 1, 0, None, True, rotation_deg=rotation, translation_cm=translation
    )


MISSED = InstanceErrors(1, 0, 1, 0)


def test_the_loss_is_the_share_by_which_mean_errors_are_larger() -> None:
    given, network = [found(1, 0.2), found(3, 0.2)], [found(2, 0.1), found(4, 0.2)]
    loss = detector_loss(given, network)
    assert loss.rotation == loss.rotation_found == pytest.approx(0.5)
    assert loss.translation == loss.translation_found == pytest.approx(-0.25)
    assert (loss.missed, loss.gained) == (0, 0)


def test_what_one_of_them_misses_counts_over_all_objects_only() -> None:
    given = [found(10, 1), found(10, 1), MISSED]
    network = [found(11, 1), MISSED, found(10, 1)]
    loss = detector_loss(given, network)
    assert loss.rotation_found == pytest.approx(0.1)
    assert loss.rotation == pytest.approx(111 / 110 - 1)
    assert loss.translation == pytest.approx(0.0)
    assert (loss.missed, loss.gained) == (1, 1)


def test_there_is_no_loss_over_nothing() -> None:
    loss = detector_loss([MISSED], [MISSED])
    assert loss.rotation == loss.rotation_found == loss.translation_found == 0.0
