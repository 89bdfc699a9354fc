# SPDX-License-Identifier: MIT
"""Feeds spoilt files to every reader and reports what is not a `PhysimError`.

    python benchmarks/fuzz.py [--target bop|csv|rle|png|mesh|yaml|weights|all]
        [--seconds 60] [--json FILE] [--out FOLDER]

With atheris installed (`pip install atheris`) inputs are guided by the code that they
reach; without it they come from hypothesis. Each target runs in a process of its own.
An input that makes a reader raise anything else, take more than 20 s or more than 4 GB
is kept in the folder of --out, and the exit status is 1.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

NAMES = ("bop", "csv", "rle", "png", "mesh", "yaml", "weights")
SECONDS_AN_INPUT = 20
MEMORY_MB = 4096


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
    names = NAMES if target == "all" else (target,)
    engine = engine or _engine()
    out.mkdir(parents=True, exist_ok=True)
    found = [_fuzz(name, seconds / len(names), engine, out) for name in names]
    table = Table("target", "inputs", "s", "memory, MB", "faults", title=engine)
    for row in found:
        table.add_row(
            *(str(row[k]) for k in ("target", "inputs", "seconds")),
            str(row["memory_mb"]),
            ", ".join(row["faults"]) or "0",
        )
    Console().print(table)
    if json_file:
        json_file.write_text(json.dumps({"engine": engine, "targets": found}, indent=1))
    raise typer.Exit(any(row["faults"] for row in found))


def _engine() -> str:
    if importlib.util.find_spec("atheris") is not None:
        return "atheris"
    print(
        "atheris is not installed (pip install atheris), so hypothesis makes the "
        "inputs, unguided by the code that they reach",
        file=sys.stderr,
    )
    return "hypothesis"


def _fuzz(name: str, seconds: float, engine: str, out: Path) -> dict[str, object]:
    """Runs one target in a process; what it found."""
    before = set(out.iterdir())
    command = [sys.executable, __file__, "--child", name, engine, str(out)]
    start = time.monotonic()
    done = subprocess.run(
        [*command, str(max(1, round(seconds)))], capture_output=True, text=True
    )
    text = done.stdout + done.stderr
    inputs = re.findall(r"(?:number_of_executed_units:|^inputs) *(\d+)", text, re.M)
    memory = re.findall(r"(?:peak_rss_mb:|^memory) *(\d+)", text, re.M)
    faults = sorted(path.name for path in set(out.iterdir()) - before)
    if done.returncode != 0 or not inputs:
        log = out / f"{name}.log"
        log.write_text(text)
        faults.append(f"see {log}")
    return {
        "target": name,
        "inputs": int(inputs[-1]) if inputs else 0,
        "seconds": round(time.monotonic() - start),
        "memory_mb": int(memory[-1]) if memory else 0,
        "faults": faults,
    }


def _run_child(name: str, engine: str, out: str, seconds: str) -> None:
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    with tempfile.TemporaryDirectory(dir=memory) as folder:
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
        nonlocal counted
        if time.monotonic() > end:
            return
        counted += 1
        start = time.monotonic()
        try:
            target.read(data)
            took = time.monotonic() - start
            assert took < SECONDS_AN_INPUT, f"took {took:.0f} s"
            assert _memory_mb() < MEMORY_MB, f"took {_memory_mb()} MB"
        except BaseException:
            (out / f"{name}-fault").write_bytes(data)
            raise

    options = settings(
        max_examples=200,
        deadline=None,
        database=None,
        phases=[Phase.generate, Phase.shrink],
        suppress_health_check=list(HealthCheck),
    )
    end, round_ = time.monotonic() + seconds, 0
    try:
        while time.monotonic() < end:
            seed(round_)(options(given(inputs(target.seeds))(read)))()
            round_ += 1
    finally:
        print(f"inputs {counted}\nmemory {_memory_mb()}", flush=True)


def _memory_mb() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        _run_child(*sys.argv[2:])
    else:
        typer.run(main)
