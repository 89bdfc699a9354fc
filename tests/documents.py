# SPDX-License-Identifier: MIT
"""The code blocks of the documents, and how their shell commands are run.

A block in ```` ```sh ```` is run by the tests, shortened by `SHORTER`, unless its first
line says `# not run by the tests: REASON`; then its commands are only parsed.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import typer

from physim_drake.cli import app
from physim_drake.models import APC11

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "examples" / "data" / "tabletop"
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted(p for p in (ROOT / "docs").rglob("*.md") if p.parent.name != "api"),
]

NOT_RUN = re.compile(r"# not run by the tests: (\S.+)\n")

_SMALL = ["--expansions", "4", "--hypotheses", "3", "--workers", "1"]
SHORTER = {
    "estimate": ["--method", "pca-icp", "--workers", "1"],
    "evaluate": [],
    "explain": _SMALL,
    "generate": ["--scenes", "1", "--objects", "1:1", "--levels", "1"],
    "models": [],
    "report": ["--methods", "physim-heuristic", *_SMALL],
}
"""Options that make a command quick; the last of two alike counts."""

TESTED_ELSEWHERE = {
    "doctor": "tests/test_packaging.py",
    "estimate-image": "tests/cli/test_estimate_image.py",
}
"""Commands without a dataset, which a test of their own runs."""

DATASETS = ("DATASET", "mydata", "apc11-dev")
"""Names of datasets in the documents; the example stands for them."""


def blocks(page: Path, language: str) -> list[str]:
    """The code blocks of a page in one language."""
    pattern = rf"^```{language}\n(.*?)^```"
    return re.findall(pattern, page.read_text(), re.DOTALL | re.MULTILINE)


def all_blocks(page: Path) -> list[tuple[str, str]]:
    """Language and text of all code blocks of a page."""
    pattern = r"^```([a-z]*)\n(.*?)^```$"
    return re.findall(pattern, page.read_text(), re.DOTALL | re.MULTILINE)


def not_run(block: str) -> str | None:
    """The reason why the tests do not run a block, if it gives one."""
    match = NOT_RUN.match(block)
    return match[1] if match else None


def commands(block: str) -> list[list[str]]:
    """The words of each command of a shell block, without comments."""
    lines = block.replace("\\\n", " ").splitlines()
    return [words for line in lines if (words := shlex.split(line, comments=True))]


def parse(words: list[str]) -> None:
    """Raises unless the program has this command, with these options and values."""
    group = typer.main.get_command(app)
    context = group.make_context("physim-drake", list(words))
    rest = [*context._protected_args, *context.args]
    while hasattr(group, "resolve_command"):
        name, group, rest = group.resolve_command(context, rest)  # type: ignore[attr-defined]
        context = group.make_context(name, rest, parent=context)
        rest = [*context._protected_args, *context.args]


def run(words: list[str]) -> None:
    """Runs a command of physim-drake in this process, shortened."""
    command = typer.main.get_command(app)
    command.main([*words, *SHORTER[words[0]]], standalone_mode=False)


def lay_out(folder: Path) -> None:
    """What the documents take to be in the current folder."""
    for name in ("examples", "models"):
        (folder / name).symlink_to(ROOT / name)
    for name in DATASETS:
        (folder / name).mkdir()
        for path in EXAMPLE.iterdir():
            (folder / name / path.name).symlink_to(path)
        (folder / name / "models").symlink_to(APC11)
