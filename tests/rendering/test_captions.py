# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from physim_drake.rendering.captions import Captions

GREY = 100
WHITE = (255, 255, 255)
Place = tuple[int, int]


def written(*places: Place, centred: bool = False) -> NDArray[np.bool_]:
    """Where a picture is changed by writing "name" at (column, bottom)."""
    canvas = np.full((120, 640, 3), GREY, np.uint8)
    captions = Captions(canvas)
    for column, bottom in places:
        captions.write("name", column, bottom, WHITE, centred=centred)
    return np.asarray((canvas != GREY).any(axis=2))


def box(changed: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    """Left, top, right, bottom, the last two exclusive."""
    rows, columns = np.nonzero(changed)
    low, high = (columns.min(), rows.min()), (columns.max() + 1, rows.max() + 1)
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def test_a_name_stands_above_its_row_and_begins_or_centres_at_its_column() -> None:
    left, _, right, bottom = box(written((300, 60)))
    assert (left, bottom) == (300, 60)
    left, _, right, bottom = box(written((300, 60), centred=True))
    assert (left + right) / 2 == pytest.approx(300, abs=1)


@pytest.mark.parametrize("place", [(-50, 60), (5000, 60), (300, -20), (300, 900)])
def test_names_stay_in_the_picture(place: Place) -> None:
    assert written(place).sum() == written((300, 60)).sum()


@pytest.mark.parametrize("second", [(300, 60), (310, 55), (290, 64)])
@pytest.mark.parametrize("bottom", [60, 5])
def test_names_do_not_cover_each_other(second: Place, bottom: int) -> None:
    column, offset = second[0], second[1] - 60
    both = written((300, bottom), (column, bottom + offset))
    assert both.sum() == 2 * written((300, 60)).sum()


def test_names_beside_each_other_keep_their_rows() -> None:
    _, top, _, bottom = box(written((100, 60), (300, 60)))
    assert (top, bottom) == box(written((100, 60)))[1::2]
