# SPDX-License-Identifier: MIT
"""The same command and seed writes the same bytes, whatever the number of workers.

Times are left out (`benchmarks.kill_cases.contents`): they are the clock's. Each run is
a process of its own, so that nothing that one leaves in memory makes the next alike.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks.kill_cases import Case, contents, estimate_case
from benchmarks.processes import run
from physim_drake.models import APC11
from tests.cli.estimating import SCENE

WORKERS = (1, 2, 4, 1)
"""Of the runs that are compared; the last is the first once more."""

CELL = """
objects: {names: [dove_beauty_bar, crayola_24_ct], count: [2, 2], levels: [2]}
look: {detector: oracle, expansions: 6, representatives: 4, latency: 0.2}
max_duration: 2.0
"""


def estimated(folder: Path) -> Case:
    return estimate_case(SCENE, "--models", str(APC11))


def generated(folder: Path) -> Case:
    size = ("--scenes", "4", "--objects", "2:2", "--levels", "1,2", "--seed", "5")
    return Case("generate", size, lambda out: (str(out / "scenes"),))


def picked(folder: Path) -> Case:
    scenario = folder / "cell.yaml"
    scenario.write_text(CELL)
    return Case(
        "pick", (str(scenario),), lambda out: ("--json", str(out / "pick.json"))
    )


@pytest.mark.parametrize(
    ("make", "shown"),
    [
        (estimated, "\n1,0,5,"),
        (generated, '"obj_id": '),
        (picked, '"looks": 1, '),
    ],
    ids=["estimate", "generate", "pick"],
)
def test_runs_write_the_same_bytes_with_1_2_and_4_workers(
    make: Callable[[Path], Case], shown: str, tmp_path: Path
) -> None:
    case = make(tmp_path)
    written = []
    for number, workers in enumerate(WORKERS):
        folder = tmp_path / str(number)
        folder.mkdir()
        run(case.command(folder, workers), tmp_path)
        written.append(contents(folder))
    assert any(shown.encode() in data for data in written[0].values())
    for other in written[1:]:
        assert other == written[0]
