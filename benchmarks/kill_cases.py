# SPDX-License-Identifier: MIT
"""Small runs of long commands, and the parts of their files that must not differ."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.processes import PROGRAM, run
from physim_drake.models import APC11

NAMES = ("estimate", "generate", "train", "report", "pick")
_MODELS = 2  # objects that the tiny detector learns
_TIMES = ("wall_time", "real_time_factor", "stages")  # in the figures of `pick`
_PAGE = "picked/index.html"  # of `pick`, with its figures, times among them
_CELL = """
objects: {names: [dove_beauty_bar], count: [1, 1], levels: [1]}
look: {noise: false, method: pca-icp, detector: oracle}
max_duration: 3.0
"""


@dataclass(frozen=True)
class Case:
    """A command whose runs are cut off.

    Attributes:
        name: name of the command.
        arguments: arguments without those for output and workers.
        output: function from a folder to the arguments that name the output.
        workers: numbers of workers that must not make a difference. Runs that are cut
            off have the first.
    """

    name: str
    arguments: tuple[str, ...]
    output: Callable[[Path], tuple[str, ...]]
    workers: tuple[int, ...] = (2,)

    def command(self, folder: Path, workers: int) -> list[str]:
        """The command line that writes into a folder."""
        ends = (*self.output(folder), *self.arguments, "--workers", str(workers))
        return [*PROGRAM, self.name, *ends]


def make_cases(folder: Path, names: Sequence[str]) -> list[Case]:
    """Makes the cases of these names, with their inputs in a folder.

    Raises:
        RuntimeError: if an input cannot be made.
    """
    size = ("--scenes", "4", "--objects", "2:3", "--seed", "5")
    generate = Case("generate", size, lambda out: (str(out / "scenes"),), (2, 4))
    if {"estimate", "report"} & set(names):
        run(generate.command(folder / "input", 2), folder)
    makers: dict[str, Callable[[], Case]] = {
        "estimate": lambda: estimate_case(folder / "input" / "scenes"),
        "generate": lambda: generate,
        "train": lambda: train_case(few_models(folder / "models", _MODELS)),
        "report": lambda: report_case(folder / "input" / "scenes"),
        "pick": lambda: pick_case(folder / "cell.yaml"),
    }
    return [makers[name]() for name in names]


def estimate_case(dataset: Path, *more: str) -> Case:
    """Estimates of a dataset with a small budget."""
    budget = ("--expansions", "12", "--hypotheses", "5", *more)
    return Case(
        "estimate",
        (str(dataset), *budget),
        lambda out: ("--out", str(out / "results.csv")),
        (2, 4),
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


def report_case(dataset: Path) -> Case:
    """A report on two methods with a small budget."""
    methods = ("--methods", "physim-heuristic,pca-icp")
    budget = ("--expansions", "6", "--hypotheses", "4")
    return Case(
        "report",
        (str(dataset), *methods, *budget),
        lambda out: ("--out", str(out / "report")),
    )


def pick_case(scenario: Path) -> Case:
    """Two moments of a cell with one object. Writes its scenario."""
    scenario.write_text(_CELL)
    return Case(
        "pick",
        (str(scenario), "--episodes", "2"),
        lambda out: ("--record", str(out / "picked"), "--json", str(out / "pick.json")),
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


def contents(folder: Path) -> dict[str, bytes]:
    """The files of a run by path, without times and what depends on them."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.suffix not in (".progress", ".tmp"):
            name = str(path.relative_to(folder))
            found[name] = b"" if name == _PAGE else _compared(path)
    return found


def _compared(path: Path) -> bytes:
    """The part of a file that is the same in every run."""
    if path.name == "results.csv":
        lines = path.read_text().splitlines()
        return "\n".join(line.rpartition(",")[0] for line in lines).encode()
    if path.name == "training.json":
        log = json.loads(path.read_text())
        for entry in log["losses"]:
            del entry["seconds"]
        return json.dumps(log).encode()
    if path.name == "pick.json":
        figures = json.loads(path.read_text())
        for entry in (figures, *figures["episodes"]):
            for name in _TIMES:
                del entry[name]
        return json.dumps(figures).encode()
    data = path.read_bytes()
    if path.suffix == ".safetensors":
        # The entries of its header come in any order.
        end = 8 + int.from_bytes(data[:8], "little")
        return json.dumps(json.loads(data[8:end]), sort_keys=True).encode() + data[end:]
    return data
