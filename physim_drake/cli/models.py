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

    Example: `physim-drake models check datasets/lab/models`
    """
    from rich.console import Console

    from physim_drake.cli.progress import Steps
    from physim_drake.objects.model import ObjectLibrary

    library, reports = ObjectLibrary.load(folder), []
    with Steps(messages(quiet), "object", len(library)) as steps:
        for model in library.values():
            reports.append(report(model))
            steps.advance()
    if json_file is not None:
        facts = [asdict(item) for item in reports]
        if output_json(json_file, facts):
            return
    console = Console()
    console.print(_table(reports, str(folder)))
    for item in reports:
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
        volume_cm3=round(float(model.mesh.volume) * 1e6, 1),
        mass=round(model.mass, 4),
        symmetry=describe_symmetry(model.symmetry),
        collision_pieces=len(model.collision_pieces),
        collision_deviation_mm=round(
            pieces_deviation(model.collision_pieces, model.mesh) * 1e3, 2
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
