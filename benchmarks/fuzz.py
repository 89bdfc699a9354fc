# SPDX-License-Identifier: MIT
"""Feeds spoilt files to every reader and reports what is not a `PhysimError`.

    python benchmarks/fuzz.py [--target bop|csv|rle|png|mesh|yaml|weights|all]
        [--seconds 60] [--json FILE] [--out FOLDER]

With atheris installed (`pip install -e '.[fuzz]'`) inputs are guided by the code that
they reach. Without it they come from hypothesis. Each target runs in a process of its
own. An input that makes a reader raise anything else, take more than 20 s or more than
4 GB is kept in the folder of --out, and the exit status is 1.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

NAMES = ("bop", "csv", "rle", "png", "mesh", "yaml", "weights")
ENGINES = ("atheris", "hypothesis")
SECONDS_AN_INPUT = 20
MEMORY_MB = 4096
_START = 600  # s that a target may take beside reading: imports, shrinking an input


@dataclass(frozen=True)
class Finding:
    """The result of one target.

    Attributes:
        target: name of the target.
        inputs: number of inputs read.
        seconds: time that it ran, its start included.
        memory_mb: largest memory of its process, MB.
        faults: names of files with inputs that failed, and other failures.
    """

    target: str
    inputs: int
    seconds: int
    memory_mb: int
    faults: list[str]

    @property
    def good(self) -> bool:
        """Whether something was read and nothing went wrong."""
        return self.inputs > 0 and not self.faults


class _TooSlowError(BaseException):
    """A reader takes too long. Not an `Exception`, which the reader could catch."""


def main(
    target: str = "all",
    seconds: float = 60.0,
    out: Path = Path("out/fuzz"),
    engine: str = "",
    json_file: Annotated[Path | None, typer.Option("--json")] = None,
) -> None:
    """Fuzzes one target, or each in turn for its share of the time."""
    if target not in (*NAMES, "all"):
        raise typer.BadParameter(f"choose from {', '.join(NAMES)} and all", None)
    engine = engine or default_engine()
    # What ends this process ends the target and removes its folder, too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    found = fuzz(NAMES if target == "all" else (target,), seconds, engine, out)
    table = Table("target", "inputs", "s", "memory, MB", "faults", title=engine)
    for row in found:
        figures = map(str, (row.inputs, row.seconds, row.memory_mb))
        table.add_row(row.target, *figures, ", ".join(row.faults) or "0")
    Console().print(table)
    if json_file:
        rows = [asdict(row) for row in found]
        json_file.write_text(json.dumps({"engine": engine, "targets": rows}, indent=1))
    raise typer.Exit(not all(row.good for row in found))


def fuzz(
    names: Sequence[str],
    seconds: float,
    engine: str,
    out: Path,
    told: Callable[[Finding], object] = lambda found: None,
) -> list[Finding]:
    """Fuzzes targets one after the other.

    Args:
        names: names of the targets.
        seconds: time to read in all, shared equally by the targets.
        engine: one of `ENGINES`.
        out: folder for inputs that fail. It is made.
        told: callback for each finished target.

    Returns:
        the result of each target, in order.
    """
    out.mkdir(parents=True, exist_ok=True)
    findings = []
    for name in names:
        findings.append(_fuzz_target(name, seconds / len(names), engine, out))
        told(findings[-1])
    return findings


def default_engine() -> str:
    """The best engine that is installed. Says so if it is not atheris."""
    if importlib.util.find_spec("atheris") is not None:
        return "atheris"
    print(
        "atheris is not installed (pip install -e '.[fuzz]'), so hypothesis makes the "
        "inputs, unguided by the code that they reach",
        file=sys.stderr,
    )
    return "hypothesis"


def _fuzz_target(name: str, seconds: float, engine: str, out: Path) -> Finding:
    """Runs one target in a process and returns what it found."""
    before = set(out.iterdir())
    start = time.monotonic()
    text, wrong = _run_process(name, max(1, round(seconds)), engine, out)
    inputs = re.findall(r"(?:number_of_executed_units:|^inputs) *(\d+)", text, re.M)
    memory = re.findall(r"(?:peak_rss_mb:|^memory) *(\d+)", text, re.M)
    faults = sorted(path.name for path in set(out.iterdir()) - before)
    if wrong or not inputs:
        log = out / f"{name}.log"
        log.write_text(text)
        faults.append(f"see {log}")
    return Finding(
        name,
        inputs=int(inputs[-1]) if inputs else 0,
        seconds=round(time.monotonic() - start),
        memory_mb=int(memory[-1]) if memory else 0,
        faults=faults,
    )


def _run_process(name: str, seconds: int, engine: str, out: Path) -> tuple[str, bool]:
    """Runs a target in a process. Returns its output, and whether it failed."""
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    with tempfile.TemporaryDirectory(dir=memory) as folder:
        command = [sys.executable, __file__, "--child", name, engine, str(out), folder]
        try:
            done = subprocess.run(
                [*command, str(seconds)],
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                encoding="utf-8",
                errors="replace",
                timeout=seconds + _START,
            )
        except subprocess.TimeoutExpired as expired:
            printed = expired.stdout or b""
            return printed.decode(errors="replace") + "\nit hung and was killed\n", True
    return done.stdout, done.returncode != 0


def _run_child(name: str, engine: str, out: str, folder: str, seconds: str) -> None:
    run = _run_atheris if engine == "atheris" else _run_hypothesis
    run(name, Path(folder), Path(out), int(seconds))


def _run_atheris(name: str, folder: Path, out: Path, seconds: int) -> None:
    import atheris

    with atheris.instrument_imports(include=["physim_drake", "trimesh.exchange"]):
        from fuzz_targets import TARGETS

        (folder / "files").mkdir()
        target = TARGETS[name](folder / "files")
    corpus = folder / "corpus"
    corpus.mkdir()
    for number, seed in enumerate(target.seeds):
        target.read(seed)
        (corpus / str(number)).write_bytes(seed)
    longest = 2 * max(map(len, target.seeds)) + 4096
    options = [
        f"-max_total_time={seconds}",
        f"-timeout={SECONDS_AN_INPUT}",
        f"-rss_limit_mb={MEMORY_MB}",
        f"-max_len={longest}",
        f"-artifact_prefix={out}/{name}-",
        "-print_final_stats=1",
    ]
    atheris.Setup([sys.argv[0], *options, str(corpus)], target.read)
    atheris.Fuzz()


def _run_hypothesis(name: str, folder: Path, out: Path, seconds: int) -> None:
    from fuzz_mutations import inputs
    from fuzz_targets import TARGETS
    from hypothesis import HealthCheck, Phase, given, seed, settings

    target = TARGETS[name](folder)
    counted = 0

    def read(data: bytes) -> None:
        """Reads an input while there is time left, and counts it."""
        nonlocal counted
        if time.monotonic() < end:
            counted += 1
            _read_within_limits(target.read, data, out / f"{name}-fault")

    options = settings(
        max_examples=200,
        deadline=None,
        database=None,
        phases=[Phase.generate, Phase.shrink],
        suppress_health_check=list(HealthCheck),
    )
    signal.signal(signal.SIGALRM, _give_up)
    end, round_ = time.monotonic() + seconds, 0
    try:
        while time.monotonic() < end:
            seed(round_)(options(given(inputs(target.seeds))(read)))()
            round_ += 1
    finally:
        print(f"inputs {counted}\nmemory {_memory_mb()}", flush=True)


def _read_within_limits(read: Callable[[bytes], None], data: bytes, keep: Path) -> None:
    """Reads an input, and writes it to a file if that fails."""
    signal.alarm(SECONDS_AN_INPUT)
    try:
        read(data)
        assert _memory_mb() < MEMORY_MB, f"took {_memory_mb()} MB"
    except KeyboardInterrupt:
        raise  # the input is not the cause
    except BaseException:
        # Whatever it is: a panic of a library in Rust and `_TooSlowError` are no
        # `Exception`. It goes on to whoever counts faults.
        keep.write_bytes(data)
        raise
    finally:
        signal.alarm(0)


def _give_up(*_: Any) -> None:
    raise _TooSlowError(f"takes more than {SECONDS_AN_INPUT} s")


def _memory_mb() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        _run_child(*sys.argv[2:])
    else:
        typer.run(main)
