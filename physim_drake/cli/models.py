# SPDX-License-Identifier: MIT
"""`physim-drake models`: what the library makes of a folder of models."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from physim_drake.cli.options import (
    JsonFile,
    LogLevel,
    Quiet,
)
from physim_drake.cli.output import LogLevelName, messages, output_json

if TYPE_CHECKING:
    from rich.table import Table

    from physim_drake.objects.library_files import ObjectEntry
    from physim_drake.objects.model import ObjectModel

models_app = typer.Typer(help="Look at object models.", no_args_is_help=True)


@dataclass(frozen=True)
class ModelReport:
    """What `models check` tells of one object; lengths in mm, mass in kg."""

    id: int
    name: str
    file: str
    extents_mm: list[float]
    diameter_mm: float
    volume_cm3: float
    mass: float
    symmetry: str
    collision_pieces: int
    collision_deviation_mm: float
    problems: list[str]


@dataclass(frozen=True)
class UnusableModel:
    """An object whose files cannot be used, and why."""

    id: int
    name: str
    file: str
    error: str


@models_app.callback()
def _group() -> None:
    """Keeps `check` a command of its own while it is the only one."""


@models_app.command()
def check(
    folder: Annotated[
        Path,
        typer.Argument(
            help="Folder of a library.yaml, BOP models folder, or folder of meshes.",
            show_default=False,
        ),
    ],
    json_file: JsonFile = None,
    quiet: Quiet = False,
    log_level: LogLevel = LogLevelName.WARNING,
) -> None:
    """Load all models of a folder; show size, symmetry, collision and problems.

    A file that cannot be used is named, and the check goes on. The exit status is 2 if
    there was one, and 0 if all can be used, whatever is noted of them.

    Example: `physim-drake models check datasets/lab/models`
    """
    from physim_drake.cli.progress import Steps
    from physim_drake.objects.library_files import find_objects

    entries = find_objects(folder)
    reports: list[ModelReport | UnusableModel] = []
    with Steps(messages(quiet), "object", len(entries)) as steps:
        for entry in entries:
            reports.append(check_object(entry))
            steps.advance()
    failed = any(isinstance(item, UnusableModel) for item in reports)
    facts = [asdict(item) for item in reports]
    if json_file is None or not output_json(json_file, facts):
        _print(reports, str(folder))
    if failed:
        raise typer.Exit(2)


def check_object(entry: ObjectEntry) -> ModelReport | UnusableModel:
    """Reads one object and gathers its facts, or why it cannot be used."""
    from physim_drake.errors import InputError
    from physim_drake.objects.model import read_model

    try:
        return report(read_model(entry))
    except InputError as error:
        return UnusableModel(entry.object_id, entry.name, str(entry.mesh), str(error))


def _print(reports: list[ModelReport | UnusableModel], title: str) -> None:
    from rich.console import Console

    console = Console()
    usable = [item for item in reports if isinstance(item, ModelReport)]
    if usable:
        console.print(_table(usable, title))
    for item in reports:
        if isinstance(item, UnusableModel):
            console.print(
                f"{item.id} {item.name} cannot be used: {item.error}", markup=False
            )
        else:
            for problem in item.problems:
                console.print(f"{item.id} {item.name}: {problem}", markup=False)


def report(model: ObjectModel) -> ModelReport:
    """Gathers the facts of one object."""
    from physim_drake.objects.convex_pieces import pieces_deviation
    from physim_drake.objects.symmetry import describe_symmetry

    return ModelReport(
        id=model.object_id,
        name=model.name,
        file=str(model.source),
        extents_mm=[round(float(x) * 1e3, 1) for x in model.extents],
        diameter_mm=round(model.diameter * 1e3, 1),
        volume_cm3=round(float(model.solid.volume) * 1e6, 1),
        mass=round(model.mass, 4),
        symmetry=describe_symmetry(model.symmetry),
        collision_pieces=len(model.collision_pieces),
        collision_deviation_mm=round(
            pieces_deviation(model.collision_pieces, model.solid) * 1e3, 2
        ),
        problems=list(model.problems),
    )


def _table(reports: list[ModelReport], title: str) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(title=title, box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    numbers = ("id", "cm³", "kg", "pieces", "off mm")
    for heading in ("id", "name", "mm", "cm³", "kg", "symmetry", "pieces", "off mm"):
        table.add_column(
            heading,
            justify="right" if heading in numbers else "left",
            overflow="fold",
            no_wrap=heading not in ("name", "symmetry"),
            min_width=12 if heading in ("name", "symmetry") else None,
        )
    for item in reports:
        table.add_row(
            str(item.id),
            item.name,
            " x ".join(f"{x:.0f}" for x in item.extents_mm),
            f"{item.volume_cm3:.0f}",
            f"{item.mass:.3f}",
            item.symmetry,
            str(item.collision_pieces),
            f"{item.collision_deviation_mm:.1f}",
        )
    return table
