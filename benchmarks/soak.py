# SPDX-License-Identifier: MIT
"""The long tests of endurance, one after the other, with one table at the end.

    python -m benchmarks.soak [--kills 50] [--fuzz-minutes 10] [--images 1000]
        [--only kills,fuzz,load] [--out FILE.md] [--resume]

Runs are killed (kills.py), readers are fed spoilt files (fuzz.py, which keeps inputs
that fail in out/fuzz), and one estimate does many images while its memory is watched
(load.py). The table goes to the console and to the file of --out. Beside that stand,
under the same name, the figures in JSON, written whenever a part is done, and the plot
of memory. With --resume, a part that was done with the same settings is not run again,
whether it passed or failed, unless it broke down. The exit status is 1 if anything
failed.
"""

from __future__ import annotations

import json
import os
import platform
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import date
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from benchmarks import fuzz, load
from benchmarks.kills import run_kills
from benchmarks.soak_table import Figures, Outcome, markdown, rows
from physim_drake.cli.progress import Steps

PARTS = ("kills", "fuzz", "load")
_ERR = Console(stderr=True)


@dataclass(frozen=True)
class Job:
    """A part to run.

    Attributes:
        part: name of the part.
        settings: settings that tell its runs apart, as JSON.
        run: function that runs it and returns figures for `soak_table.rows`, as JSON.
    """

    part: str
    settings: Figures
    run: Callable[[], Figures]


def main(
    kills: Annotated[int, typer.Option(min=1)] = 50,
    fuzz_minutes: Annotated[float, typer.Option(min=0.01)] = 10.0,
    images: Annotated[int, typer.Option(min=1)] = 1000,
    only: str = ",".join(PARTS),
    out: Path = Path("out/soak/soak.md"),
    seed: int = 0,
    resume: bool = False,
) -> None:
    """Kills runs, fuzzes readers, estimates many images, prints and writes a table."""
    parts = only.split(",")
    if not set(parts) <= set(PARTS):
        raise typer.BadParameter(f"--only: choose from {', '.join(PARTS)}")
    out.parent.mkdir(parents=True, exist_ok=True)
    jobs = {
        "kills": kill_job(kills, seed),
        "fuzz": fuzz_job(fuzz_minutes),
        "load": load_job(images, out.with_suffix(".png")),
    }
    state = out.with_suffix(".json")
    # What ends this process ends the parts, too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        outcomes = soak([jobs[part] for part in PARTS if part in parts], state, resume)
    except (KeyboardInterrupt, SystemExit) as end:
        _ERR.print(f"interrupted: parts that are done are in {state}; --resume goes on")
        raise typer.Exit(getattr(end, "code", 130)) from None
    options = f"--kills {kills} --fuzz-minutes {fuzz_minutes:g} --images {images}"
    command = f"python -m benchmarks.soak {options}"
    out.write_text(markdown(outcomes, command, _machine()))
    _print(outcomes)
    print(out)
    raise typer.Exit(not all(outcome.good for outcome in outcomes))


def kill_job(count: int, seed: int) -> Job:
    """Runs that are cut off."""

    def run() -> Figures:
        """Cuts runs off and tells how often that has happened."""
        with Steps(_ERR, "kill", count) as steps:
            tallies = run_kills(count, seed=seed, told=steps.reach)
        return {name: asdict(tally) for name, tally in tallies.items()}

    return Job("kills", {"kills": count, "seed": seed}, run)


def fuzz_job(minutes: float) -> Job:
    """Readers that are fed spoilt files."""
    engine = fuzz.default_engine()

    def run() -> Figures:
        """Fuzzes all targets and tells of each when it is done."""
        with Steps(_ERR, "reader", len(fuzz.NAMES)) as steps:
            found = fuzz.fuzz(
                fuzz.NAMES,
                60 * minutes,
                engine,
                Path("out/fuzz"),
                lambda finding: steps.advance(f"{finding.target} done"),
            )
        return {"targets": [asdict(finding) for finding in found]}

    return Job("fuzz", {"minutes": minutes, "engine": engine}, run)


def load_job(images: int, plot: Path) -> Job:
    """One estimate of many images, which tells itself how far it is."""

    def run() -> Figures:
        """Watches the estimate's memory and draws it."""
        figures, samples = load.measure(images)
        load.draw(samples, plot)
        return figures

    return Job("load", {"images": images}, run)


def soak(jobs: Sequence[Job], state: Path, resume: bool) -> list[Outcome]:
    """Runs parts one after the other, and keeps each result in a file at once.

    Args:
        jobs: parts to run.
        state: JSON file of the results.
        resume: whether to take parts from the file if their settings are the same.

    Returns:
        the outcomes, in order of `jobs`.
    """
    known = _read(state) if resume else {}
    outcomes = []
    for job in jobs:
        before = known.get(job.part)
        if before and before.settings == job.settings and not before.error:
            _ERR.print(f"{job.part}: was done before")
            outcomes.append(before)
            continue
        _ERR.print(
            f"{job.part}: {', '.join(f'{k} {v}' for k, v in job.settings.items())}"
        )
        outcomes.append(_run(job))
        known[job.part] = outcomes[-1]
        _write(state, known)
    return outcomes


def _run(job: Job) -> Outcome:
    start, figures, error = time.monotonic(), {}, ""
    try:
        figures = dict(job.run())
    except Exception as exception:
        # Whatever breaks a part down, the others are still worth their hours, and the
        # table says why this one failed.
        traceback.print_exc()
        error = f"{type(exception).__name__}: {exception}"
    return Outcome(
        job.part,
        job.settings,
        figures,
        seconds=round(time.monotonic() - start, 1),
        date=date.today().isoformat(),
        commit=_commit(),
        error=error,
    )


def _read(state: Path) -> dict[str, Outcome]:
    if not state.is_file():
        return {}
    known = json.loads(state.read_text())
    return {part: Outcome(**fields) for part, fields in known.items()}


def _write(state: Path, known: Mapping[str, Outcome]) -> None:
    """Writes the file whole or not at all."""
    fresh = state.with_name(state.name + ".tmp")
    fields = {part: asdict(outcome) for part, outcome in known.items()}
    fresh.write_text(json.dumps(fields, indent=1) + "\n")
    os.replace(fresh, state)


def _commit() -> str:
    """The commit of the code, marked if files differ from it."""
    command = ["git", "describe", "--always", "--dirty", "--exclude=*"]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, cwd=Path(__file__).parent
        )
    except OSError:
        return "unknown"
    return done.stdout.strip() or "unknown"


def _machine() -> str:
    cores = len(os.sched_getaffinity(0))
    return f"{cores} cores, Python {platform.python_version()}"


def _print(outcomes: Sequence[Outcome]) -> None:
    table = Table("part", "what was run", "outcome", "figures")
    for outcome in outcomes:
        for row in rows(outcome):
            verdict = "passed" if row.good else "failed"
            table.add_row(outcome.part, row.what, verdict, row.figures)
    Console(width=110).print(table)


if __name__ == "__main__":
    typer.run(main)
