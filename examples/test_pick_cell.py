# SPDX-License-Identifier: MIT
"""An integration test of a whole pick cell, to copy.

pytest examples/test_pick_cell.py
"""

from __future__ import annotations

from pathlib import Path

import pytest

from physim_drake.episodes.runner import EpisodeRunner
from physim_drake.picking.scenario import load_scenario
from physim_drake.picking.task_state import EventKind

SCENARIO = Path(__file__).parent / "scenarios" / "single.yaml"


@pytest.mark.timeout(300)
def test_one_object_is_found_picked_and_put_into_the_tote() -> None:
    """What is seen is where it truly is, and ends where it should."""
    with EpisodeRunner(load_scenario(SCENARIO)) as runner:
        result = runner.run(0)
    assert result.cleared == len(result.objects) == 1
    assert result.picks == result.succeeded == 1
    assert result.count(EventKind.NO_SEAL) == result.dropped == 0
    assert result.end == "nothing is left on the table"
    first, *later = result.looks
    for error in first.errors:
        assert error.translation is not None
        assert error.translation < 0.005
    assert all(not look.errors for look in later), "the table is empty then"
