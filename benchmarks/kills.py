# SPDX-License-Identifier: MIT
"""Whether long runs survive being killed, and end with the files of an unbroken one.

    python -m benchmarks.kills [--kills 50] [--out FILE.json] [--seed 0]
                               [--only estimate,generate,train,report,pick]

Small runs of the commands that take long are cut off at random moments: the main
process is killed (SIGKILL), one of its workers is, or the run is asked to stop (Ctrl-C
or SIGTERM). A run that was cut off goes on with `--resume`. One that ends is compared,
byte by byte except for times, with an undisturbed run of one worker. A kill is survived
if the run ends with the same files. A process that still runs a second after its main
process ended is an orphan. What is left in temporary folders, in shared memory or
beside the results is litter.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.kill_cases import NAMES, Case, contents, make_cases
from benchmarks.processes import (
    command,
    end,
    outlived,
    printed,
    run,
    segments,
    session,
    started,
)
from physim_drake.cli.progress import Steps

_STOP_LIMIT = 10.0  # s, of which two are promised and the rest is for a busy machine
_OF_TORCH = "torchinductor_"  # an empty folder that torch makes for its compiler
_HANG = 1800.0  # s, far beyond what any of these runs takes


@dataclass
class Tally:
    """What happened to the runs of one case.

    Attributes:
        main: times the main process was killed.
        worker: times a worker was killed.
        stopped: times the run was asked to stop.
        survived: number of these that did not change the results.
        runs: number of runs that ended.
        same: number of these with the files of the unbroken run.
        orphans: number of processes that outlived their main process.
        litter: number of files, folders and shared memory left beside the results.
        slowest_stop: longest time from the request to the end of the process, s.
        wrong: other faults.
    """

    main: int = 0
    worker: int = 0
    stopped: int = 0
    survived: int = 0
    runs: int = 0
    same: int = 0
    orphans: int = 0
    litter: int = 0
    slowest_stop: float = 0.0
    wrong: list[str] = field(default_factory=list)

    @property
    def kills(self) -> int:
        """How often a run was cut off in any way."""
        return self.main + self.worker + self.stopped

    @property
    def good(self) -> bool:
        """Whether everything was as it should be."""
        left = self.orphans + self.litter
        return not (self.wrong or left or self.same < self.runs)


def main(
    kills: Annotated[int, typer.Option(min=1)] = 50,
    out: Path | None = None,
    seed: int = 0,
    only: str = ",".join(NAMES),
) -> None:
    """Cuts runs off, resumes them, compares and counts."""
    names = only.split(",")
    if not set(names) <= set(NAMES):
        raise typer.BadParameter(f"--only: choose from {', '.join(NAMES)}")
    # What ends this process ends the runs, too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    with Steps(Console(stderr=True), "kill", kills) as steps:
        tallies = run_kills(kills, names, seed, steps.reach)
    Console(width=110).print(_table(tallies))
    if out is not None:
        out.write_text(json.dumps({n: asdict(t) for n, t in tallies.items()}, indent=1))
    if not all(t.good for t in tallies.values()):
        sys.exit(1)


def run_kills(
    kills: int,
    names: Sequence[str] = NAMES,
    seed: int = 0,
    told: Callable[[int], object] = lambda kills: None,
) -> dict[str, Tally]:
    """Divides kills among commands.

    Args:
        kills: number of kills in all.
        names: names of the commands.
        seed: seed of what happens when.
        told: callback for the number of kills so far.

    Returns:
        what happened, by command. If a command failed altogether, its tally says so.
    """
    tallies: dict[str, Tally] = {}
    with tempfile.TemporaryDirectory(prefix="kills-") as name:
        folder = Path(name)
        cases = make_cases(folder, names)
        for number, case in enumerate(cases):
            share = kills // len(cases) + (number < kills % len(cases))
            rng = np.random.default_rng([seed, number])
            tally = tallies[case.name] = Tally()

            def tell() -> None:
                told(sum(t.kills for t in tallies.values()))

            try:
                cut_off(case, folder / case.name, share, rng, tally, tell)
            except RuntimeError as error:
                tally.wrong.append(str(error))
    return tallies


def cut_off(
    case: Case,
    folder: Path,
    kills: int,
    rng: np.random.Generator,
    tally: Tally,
    told: Callable[[], object] = lambda: None,
) -> None:
    """Cuts runs of a case off a number of times, and counts.

    Args:
        case: case to run.
        folder: folder to run in. It is made.
        kills: number of kills.
        rng: source of when and what to kill.
        tally: tally to add to.
        told: callback after each end of a process.

    Raises:
        RuntimeError: if a run fails or hangs.
    """
    begun, shared = time.monotonic(), segments()
    expected = _unbroken(case, folder / "unbroken", 1)
    seconds = time.monotonic() - begun
    for count in case.workers:
        found = _unbroken(case, folder / f"{count}-workers", count)
        if found != expected:
            said = differences(expected, found)
            tally.wrong.append(f"{case.name}, {count} workers: {said}")
    goal, broken = tally.kills + kills, folder / "broken"
    while tally.kills < goal:
        if broken.exists():
            shutil.rmtree(broken)
        broken.mkdir()
        before, ended = tally.kills, False
        while not ended:
            delay = seconds * rng.random()
            ended = _run_once(case, broken, goal, delay, rng, tally)
            told()
        _judge(case, broken, expected, tally.kills - before, tally)
    _count_litter(case, segments() - shared, tally)


def _judge(
    case: Case, folder: Path, expected: Mapping[str, bytes], kills: int, tally: Tally
) -> None:
    """Compares what a run left that ended after some kills."""
    tally.runs += 1
    found = contents(folder)
    if found == expected:
        tally.same += 1
        tally.survived += kills
    else:
        tally.wrong.append(f"{case.name}: {differences(expected, found)}")
    scratch = folder.parent / "tmp"
    left = [path for path in scratch.iterdir() if not path.name.startswith(_OF_TORCH)]
    _count_litter(case, (*left, *folder.rglob("*.tmp")), tally)
    shutil.rmtree(scratch)  # so that nothing is counted again


def _count_litter(case: Case, left: Iterable[Path], tally: Tally) -> None:
    names = [path.name for path in left]
    if names:
        tally.litter += len(names)
        tally.wrong.append(f"{case.name} left {names}")


def _run_once(
    case: Case,
    folder: Path,
    goal: int,
    delay: float,
    rng: np.random.Generator,
    tally: Tally,
) -> bool:
    """Begins or resumes a run, which may be cut off. Returns whether it ended well."""
    arguments = [*case.command(folder, case.workers[0]), "--resume"]
    with started(arguments, folder.parent / "tmp") as (process, printing):
        if tally.kills < goal:
            how = rng.choice(["main", "worker", "stopped"], p=[0.4, 0.4, 0.2])
            try:
                process.wait(delay)
            except subprocess.TimeoutExpired:
                _strike(process, str(how), rng, tally)
        try:
            process.wait(_HANG)
        except subprocess.TimeoutExpired as error:
            raise RuntimeError(f"{case.name} hung for {_HANG:.0f} s") from error
        orphans = outlived(process.pid)
        tally.orphans += len(orphans)
        end(orphans)
        output = printed(printing)
    # A signal that comes before the command begins, or when it is over, just ends it.
    if process.returncode in (0, -signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT):
        return process.returncode == 0
    if process.returncode in (130, 143):
        said = [line for line in output.splitlines() if "interrupted: " in line]
        if len(said) != 1 or "Traceback" in output:
            tally.wrong.append(f"said at an interrupt: {output!r}")
        return False
    raise RuntimeError(f"{case.name} ended with {process.returncode}:\n{output}")


def _strike(
    process: subprocess.Popen[bytes], how: str, rng: np.random.Generator, tally: Tally
) -> None:
    """Cuts a run off in one of the ways."""
    if how == "worker":
        # The session's others are its workers and what helps Python to start them.
        others = [pid for pid in session(process.pid) if "spawn_main" in command(pid)]
        if not others:
            how = "main"
        else:
            try:
                os.kill(int(rng.choice(others)), signal.SIGKILL)
            except ProcessLookupError:
                return
    if how == "main":
        process.kill()
    if how == "stopped":
        begun = time.monotonic()
        if rng.random() < 0.5:
            process.send_signal(signal.SIGTERM)
        elif rng.random() < 0.5:
            process.send_signal(signal.SIGINT)
        else:
            os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        try:
            process.wait(_STOP_LIMIT)
        except subprocess.TimeoutExpired:
            process.kill()
            tally.wrong.append(f"ran on for {_STOP_LIMIT:.0f} s when asked to stop")
        tally.slowest_stop = max(tally.slowest_stop, time.monotonic() - begun)
    setattr(tally, how, getattr(tally, how) + 1)


def _unbroken(case: Case, folder: Path, workers: int) -> dict[str, bytes]:
    folder.mkdir(parents=True)
    run(case.command(folder, workers), folder.parent)
    return contents(folder)


def differences(expected: Mapping[str, bytes], found: Mapping[str, bytes]) -> str:
    """Which files are missing, too many or other than expected."""
    missing, extra = sorted(set(expected) - set(found)), set(found) - set(expected)
    other = [n for n in expected if n in found and expected[n] != found[n]]
    return f"missing {missing}, too many {sorted(extra)}, other {other}"


def _table(tallies: Mapping[str, Tally]) -> Table:
    table = Table()
    headers = ("main killed", "worker", "stopped", "survived", "runs", "same files")
    table.add_column("command")
    for header in (*headers, "orphans", "litter", "slowest stop, s"):
        table.add_column(header, justify="right")
    for name, t in tallies.items():
        counts = (t.main, t.worker, t.stopped, t.survived, t.runs, t.same)
        left = (t.orphans, t.litter, f"{t.slowest_stop:.1f}")
        table.add_row(name, *map(str, (*counts, *left)))
    return table


if __name__ == "__main__":
    typer.run(main)
