# SPDX-License-Identifier: MIT
"""Whether long runs survive being killed, and end with the files of an unbroken one.

    python benchmarks/kills.py [--kills 50] [--out FILE.json] [--seed 0]
                               [--only estimate,generate,train]

Small runs of `estimate`, `generate` and `train` are cut off at random moments: the main
process is killed (SIGKILL), one of its workers is, or the run is asked to stop (Ctrl-C
or SIGTERM). What was cut off goes on with `--resume`; what ends is compared, byte by
byte but for times, with a run that nothing happened to and that had one worker. After
each end of a main process, what still runs of it a second later is an orphan; what is
left in temporary folders or beside the results, and is none of them, is litter.
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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from physim_drake.models import APC11

PROGRAM = (
    sys.executable,
    "-c",
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "from physim_drake.cli import main; main()",
)
_MODELS = 2  # objects that the tiny detector learns
_ORPHAN = 1.0  # s


@dataclass(frozen=True)
class Case:
    """A command whose runs are cut off.

    Attributes:
        name: the command.
        arguments: its arguments but for where it writes and its workers.
        output: gives the arguments that say where it writes, for a folder.
    """

    name: str
    arguments: tuple[str, ...]
    output: Callable[[Path], tuple[str, ...]]

    def command(self, folder: Path, workers: int) -> list[str]:
        """The command line that writes into a folder."""
        ends = (*self.output(folder), *self.arguments, "--workers", str(workers))
        return [*PROGRAM, self.name, *ends]


@dataclass
class Tally:
    """What happened to the runs of one case.

    Attributes:
        main: times the main process was killed.
        worker: times a worker was.
        stopped: times the run was asked to stop.
        runs: that came to their end.
        same: of these, those with the files of the unbroken run.
        orphans: processes that outlived their main process.
        litter: files and folders that were left and are no results.
        slowest_stop: from the request to the end of the process, s.
        wrong: what else was not as it should be.
    """

    main: int = 0
    worker: int = 0
    stopped: int = 0
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


def main(
    kills: Annotated[int, typer.Option(min=1)] = 50,
    out: Path | None = None,
    seed: int = 0,
    only: str = "estimate,generate,train",
) -> None:
    """Cuts runs off, resumes them, compares and counts."""
    tallies: dict[str, Tally] = {}
    names = only.split(",")
    with tempfile.TemporaryDirectory(prefix="kills-") as name:
        folder = Path(name)
        cases = make_cases(folder, names)
        for number, case in enumerate(cases):
            share = kills // len(cases) + (number < kills % len(cases))
            rng = np.random.default_rng([seed, number])
            workers = (2, 4) if case.name != "train" else (2,)
            tally = Tally()
            cut_off(case, folder / case.name, share, rng, tally, workers)
            tallies[case.name] = tally
            print(f"{case.name}: {asdict(tally)}", file=sys.stderr)
    Console(width=110).print(_table(tallies))
    if out is not None:
        out.write_text(json.dumps({n: asdict(t) for n, t in tallies.items()}, indent=1))
    if any(t.wrong or t.same < t.runs or t.orphans for t in tallies.values()):
        sys.exit(1)


def make_cases(folder: Path, names: Sequence[str]) -> list[Case]:
    """The cases of these names; makes what they read in a folder."""
    generate = Case(
        "generate",
        ("--scenes", "4", "--objects", "2:3", "--seed", "5"),
        lambda out: (str(out / "scenes"),),
    )
    cases = []
    if "estimate" in names:
        run(generate.command(folder / "input", 2), folder)
        cases.append(estimate_case(folder / "input" / "scenes"))
    if "generate" in names:
        cases.append(generate)
    if "train" in names:
        cases.append(train_case(few_models(folder / "models", _MODELS)))
    return cases


def estimate_case(dataset: Path, *more: str) -> Case:
    """Estimates of a dataset with a small budget."""
    budget = ("--expansions", "12", "--hypotheses", "5", *more)
    return Case(
        "estimate",
        (str(dataset), *budget),
        lambda out: ("--out", str(out / "results.csv")),
    )


def train_case(models: Path) -> Case:
    """A detector that learns for a moment."""
    size = "--scenes 2 --views 1 --test-images 2 --steps 6 --batch 1 --image-size 64"
    exact = "--save-every 2 --threads 1 --device cpu --precision float32"
    return Case(
        "train",
        ("--models", str(models), *size.split(), *exact.split()),
        lambda out: (str(out / "run"),),
    )


def few_models(folder: Path, count: int) -> Path:
    """A library of the first few of the objects that come with the package."""
    folder.mkdir(parents=True)
    text = (APC11 / "library.yaml").read_text()
    kept = text.split("- id: ")[: count + 1]
    (folder / "library.yaml").write_text("- id: ".join(kept))
    for source in APC11.iterdir():
        if source.is_dir():
            (folder / source.name).symlink_to(source)
    return folder


def cut_off(
    case: Case,
    folder: Path,
    kills: int,
    rng: np.random.Generator,
    tally: Tally,
    workers: Sequence[int] = (2,),
) -> None:
    """Cuts runs of a case off until that has happened so often, and counts.

    Args:
        case: what runs.
        folder: where; is made.
        kills: how often.
        rng: says when, and what is killed.
        tally: is added to.
        workers: of unbroken runs that are compared, too; the first of them is that of
            runs that are cut off.
    """
    begun = time.monotonic()
    expected = _unbroken(case, folder / "unbroken", 1)
    seconds = time.monotonic() - begun
    for count in workers:
        name = f"{count}-workers"
        if _unbroken(case, folder / name, count) != expected:
            tally.wrong.append(f"{case.name}: other files with {count} workers")
    goal, broken = tally.kills + kills, folder / "broken"
    while tally.kills < goal:
        if broken.exists():
            shutil.rmtree(broken)
        broken.mkdir()
        ended = False
        while not ended:
            ended = _run_once(
                case, broken, workers[0], goal, seconds * rng.random(), rng, tally
            )
        tally.runs += 1
        found = contents(broken)
        if found == expected:
            tally.same += 1
        else:
            tally.wrong.append(f"{case.name}: {differences(expected, found)}")
        tally.litter += len(_litter(broken)) + len(_litter(folder / "tmp"))


def _run_once(
    case: Case,
    folder: Path,
    workers: int,
    goal: int,
    delay: float,
    rng: np.random.Generator,
    tally: Tally,
) -> bool:
    """Begins or resumes a run, which may be cut off; returns whether it ended well."""
    process = start([*case.command(folder, workers), "--resume"], folder.parent / "tmp")
    if tally.kills < goal:
        how = rng.choice(["main", "worker", "stopped"], p=[0.4, 0.4, 0.2])
        try:
            process.wait(delay)
        except subprocess.TimeoutExpired:
            _strike(process, str(how), rng, tally)
    output = process.communicate()[0]
    time.sleep(0.05)
    for pid in _outlived(process.pid):
        tally.orphans += 1
        os.kill(pid, signal.SIGKILL)
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
    process: subprocess.Popen[str], how: str, rng: np.random.Generator, tally: Tally
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
        process.wait()
        tally.slowest_stop = max(tally.slowest_stop, time.monotonic() - begun)
    setattr(tally, how, getattr(tally, how) + 1)


def start(command: Sequence[str], scratch: Path) -> subprocess.Popen[str]:
    """Starts a program in a session of its own, with a folder for temporary files."""
    scratch.mkdir(parents=True, exist_ok=True)
    return subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        env={**os.environ, "TMPDIR": str(scratch), "OMP_NUM_THREADS": "1"},
    )


def run(command: Sequence[str], folder: Path) -> None:
    """Runs a program to its end.

    Raises:
        RuntimeError: where it fails.
    """
    process = start(command, folder / "tmp")
    output = process.communicate()[0]
    if process.returncode != 0:
        raise RuntimeError(f"{' '.join(command[3:])}:\n{output}")


def session(pid: int) -> list[int]:
    """The living processes of a session but its leader."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, leader = path.read_text().rpartition(")")[2].split()[:4]
        except OSError:
            continue  # it has ended meanwhile
        number = int(path.parent.name)
        if int(leader) == pid != number and state != "Z":
            found.append(number)
    return found


def command(pid: int) -> str:
    """The command line of a process, empty where it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return ""


def _outlived(pid: int) -> list[int]:
    """What still runs of a session some time after its leader ended."""
    deadline = time.monotonic() + _ORPHAN
    while (left := session(pid)) and time.monotonic() < deadline:
        time.sleep(0.02)
    return left


def _unbroken(case: Case, folder: Path, workers: int) -> dict[str, bytes]:
    folder.mkdir(parents=True)
    run(case.command(folder, workers), folder.parent)
    return contents(folder)


def contents(folder: Path) -> dict[str, bytes]:
    """The files of a run by path, without times and what depends on them."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.suffix not in (".progress", ".tmp"):
            found[str(path.relative_to(folder))] = _without_times(path)
    return found


def _without_times(path: Path) -> bytes:
    if path.name == "results.csv":
        lines = path.read_text().splitlines()
        return "\n".join(line.rpartition(",")[0] for line in lines).encode()
    if path.name == "training.json":
        log = json.loads(path.read_text())
        for entry in log["losses"]:
            del entry["seconds"]
        return json.dumps(log).encode()
    return path.read_bytes()


def differences(expected: Mapping[str, bytes], found: Mapping[str, bytes]) -> str:
    """Which files are missing, too many or other than expected."""
    missing, extra = sorted(set(expected) - set(found)), set(found) - set(expected)
    other = [n for n in expected if n in found and expected[n] != found[n]]
    return f"missing {missing}, too many {sorted(extra)}, other {other}"


def _litter(folder: Path) -> list[Path]:
    """Temporary files and folders that are left."""
    if folder.name == "tmp":
        return list(folder.iterdir())
    return list(folder.rglob("*.tmp"))


def _table(tallies: Mapping[str, Tally]) -> Table:
    table = Table()
    headers = ("main killed", "worker killed", "stopped", "runs", "same files")
    table.add_column("command")
    for header in (*headers, "orphans", "litter", "slowest stop, s"):
        table.add_column(header, justify="right")
    for name, t in tallies.items():
        counts = (t.main, t.worker, t.stopped, t.runs, t.same, t.orphans, t.litter)
        table.add_row(name, *map(str, counts), f"{t.slowest_stop:.1f}")
    return table


if __name__ == "__main__":
    typer.run(main)
