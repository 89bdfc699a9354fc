# SPDX-License-Identifier: MIT
"""`pick` and `report`, killed while they are at it, go on and end the same.

They are killed when the first piece of work is done; benchmarks/kills.py chooses other
moments.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.processes import PROGRAM, end, run, session, started
from physim_drake.models import APC11
from tests.cli.estimating import SCENE
from tests.cli.test_pick import SHORT, scenario, without_times

_LIMIT = 250.0  # s, on a busy machine


def program(*arguments: object) -> list[str]:
    return [*PROGRAM, *map(str, arguments), "--resume"]


def killed_and_resumed(command: Sequence[str], progress: Path, folder: Path) -> None:
    """Kills a run once the first piece of its work is noted, then does the rest.

    Args:
        command: of the run.
        progress: its progress file.
        folder: of its results, with one for temporary files beside.
    """
    scratch = folder.parent / "tmp"
    deadline = time.monotonic() + _LIMIT
    with started(command, scratch) as (process, _):
        while not (progress.exists() and progress.read_text().count("\n") == 2):
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.02)
        process.kill()
        process.wait()
        end(session(process.pid))
    kept = progress.read_bytes()
    assert list(folder.rglob("index.html")) == list(folder.rglob("*.json")) == []
    run(command, folder.parent)
    assert progress.read_bytes().startswith(kept)
    assert list(scratch.iterdir()) == list(folder.rglob("*.tmp")) == []


def files(folder: Path) -> dict[str, bytes]:
    """Those of a report."""
    return {
        path.name: path.read_bytes()
        for path in folder.iterdir()
        if path.suffix != ".progress"
    }


def test_a_report_that_is_killed_goes_on(tmp_path: Path) -> None:
    def report(out: Path) -> list[str]:
        budget = ("--expansions", 6, "--hypotheses", 4, "--workers", 2)
        methods = ("--methods", "physim-heuristic,pca-icp", "--models", APC11)
        return program("report", SCENE, "--out", out, *methods, *budget)

    whole, broken = tmp_path / "whole", tmp_path / "broken"
    run(report(whole), tmp_path)
    killed_and_resumed(report(broken), broken / "report.progress", broken)
    assert files(broken) == files(whole)


def test_a_pick_that_is_killed_goes_on(tmp_path: Path) -> None:
    cell = scenario(tmp_path, SHORT)

    def pick(out: Path) -> list[str]:
        out.mkdir()
        places = ("--record", out / "report", "--json", out / "figures.json")
        return program("pick", cell, "--episodes", 2, *places)

    whole, broken = tmp_path / "whole", tmp_path / "broken"
    run(pick(whole), tmp_path)
    killed_and_resumed(pick(broken), broken / "report" / "pick.progress", broken)
    assert without_times(broken) == without_times(whole)
