# SPDX-License-Identifier: MIT
"""`physim-drake pick`: let the pick cell clear its table."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from physim_drake.cli.options import (
    LogLevel,
    LogLevelName,
    Quiet,
    messages,
    write_json,
)
from physim_drake.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pydrake.geometry import Meshcat
    from pydrake.systems.framework import Context
    from rich.table import Table

    from physim_drake.cli.progress import Steps
    from physim_drake.picking.episode import EpisodeResult
    from physim_drake.picking.scenario import PickScenario
    from physim_drake.systems.episodes import EpisodeRunner
    from physim_drake.systems.pick_cell import PickCell


class Detector(StrEnum):
    """Names of `DetectorName`, which costs too much to import here."""

    NETWORK = "network"
    ORACLE = "oracle"


def pick(
    scenario: Annotated[
        Path, typer.Argument(help="The cell, its objects, its task: a YAML file.")
    ],
    seed: Annotated[
        int | None,
        typer.Option(
            min=0, help="Of all random choices.", show_default="the scenario's"
        ),
    ] = None,
    episodes: Annotated[
        int, typer.Option(min=1, help="How many, each with other objects.")
    ] = 1,
    detector: Annotated[
        Detector | None,
        typer.Option(
            help="A trained network finds the objects in the images, or an oracle that "
            "knows where they are.",
            show_default="the scenario's",
        ),
    ] = None,
    weights: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Of the network: what physim-drake train wrote.",
            show_default="the scenario's",
        ),
    ] = None,
    meshcat: Annotated[
        bool,
        typer.Option("--meshcat/--headless", help="Whether to show it in a browser."),
    ] = False,
    host: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS", help="Where Meshcat listens; * for every address."
        ),
    ] = "localhost",
    record: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Write a report with replays into this folder."
        ),
    ] = None,
    json_file: Annotated[
        Path | None,
        typer.Option(
            "--json",
            metavar="FILE",
            help="Write all figures to FILE; - prints them instead of the table.",
        ),
    ] = None,
    quiet: Quiet = False,
    log_level: LogLevel = LogLevelName.WARNING,
) -> None:
    """Clear a table with a robot: look, estimate, plan, pick, place, look again.

    The robot, its gripper, its camera and the objects are simulated; what is picked is
    decided from estimated poses alone. Prints, by episode and over all: objects cleared
    into the tote; picks tried, succeeded and dropped; the median errors of the
    estimates; picks an hour; simulated time over wall time. With the same seed, all but
    the wall times come out the same.

    Example: `physim-drake pick examples/scenarios/clutter.yaml --episodes 10 --seed 0`
    """
    from dataclasses import replace

    from rich.console import Console

    from physim_drake.cli.progress import Steps
    from physim_drake.files import make_folder
    from physim_drake.picking.episode import summary
    from physim_drake.picking.scenario import load_scenario
    from physim_drake.reporting.episodes import write_episodes_report
    from physim_drake.systems.episodes import EpisodeRunner, local_meshcat
    from physim_drake.systems.pick_cell import PickCellParts

    loaded = _choose_detector(load_scenario(scenario), detector, weights)
    if seed is not None:
        loaded = replace(loaded, random_seed=seed)
    if record is not None:
        make_folder(record)
    shown = local_meshcat(host) if meshcat or record is not None else None
    if meshcat and shown is not None:
        typer.echo(f"Meshcat: {shown.web_url()}", err=True)
    results: list[EpisodeResult] = []
    replays: list[str] = []
    try:
        steps = Steps(messages(quiet), "episode", episodes)
        with EpisodeRunner(loaded, PickCellParts(meshcat=shown)) as runner, steps:
            for number in range(episodes):
                results.append(_run(runner, number, episodes, steps))
                if record is not None and shown is not None:
                    replays.append(_replay(record, number, shown))
    except InputError as error:
        raise _in_file(error, scenario) from error
    if record is not None:
        write_episodes_report(results, replays, str(loaded.random_seed), record)
    if json_file is not None and write_json(json_file, summary(results)):
        return
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = 120
    console.print(_table(results))
    for result in results:
        for outcome in result.objects:
            if not outcome.cleared:
                console.print(
                    f"episode {result.episode + 1}, {outcome.name} is left: "
                    f"{outcome.reason}"
                )


def _choose_detector(
    scenario: PickScenario, detector: Detector | None, weights: Path | None
) -> PickScenario:
    from dataclasses import replace

    from physim_drake.picking.scenario import DetectorName

    look = scenario.look
    if detector is not None:
        look = replace(look, detector=DetectorName(detector))
    if weights is not None:
        if look.detector is DetectorName.ORACLE:
            raise InputError(
                "--weights", "given with an oracle", "give --detector network"
            )
        look = replace(look, weights=str(weights))
    return replace(scenario, look=look)


def _run(runner: EpisodeRunner, number: int, count: int, steps: Steps) -> EpisodeResult:
    """One episode; how far it is, then a line about it."""

    def show(cell: PickCell, context: Context) -> None:
        phase = cell.task.task_state(cell.task.GetMyContextFromRoot(context)).phase
        steps.reach(number, f"{context.get_time():.1f} s, {phase}")

    result = runner.run(number, show)
    steps.say(
        f"episode {number + 1} of {count}: {result.cleared} of {len(result.objects)} "
        f"objects cleared, {result.simulated:.0f} s simulated in {result.wall:.0f} s; "
        f"{result.end}"
    )
    steps.reach(number + 1)
    return result


def _replay(folder: Path, number: int, meshcat: Meshcat) -> str:
    """Writes an episode's replay; returns the file's name."""
    from physim_drake.files import write_atomically

    name = f"replay-{number + 1:03d}.html"
    with write_atomically(folder / name) as file:
        file.write(meshcat.StaticHtml())
    return name


def _in_file(error: InputError, scenario: Path) -> InputError:
    """The same error, said of the scenario's file."""
    if error.source == str(scenario):
        return error
    where = f"{error.source}: {error.field}" if error.field else error.source
    return InputError(scenario, error.problem, error.remedy, where)


def _table(results: Sequence[EpisodeResult]) -> Table:
    from rich import box
    from rich.table import Table

    from physim_drake.picking.episode import figures

    table = Table(box=box.SIMPLE_HEAD, padding=0, pad_edge=False)
    table.add_column("episode")
    for header in (
        "objects",
        "cleared",
        "picks",
        "suc-\nceeded",
        "dropped",
        "looks",
        "rot.\ndeg",
        "dist.\nmm",
        "simu-\nlated s",
        "wall\ns",
        "picks\nan hour",
        "real-time\nfactor",
    ):
        table.add_column(header, justify="right", no_wrap=True)
    for result in results:
        table.add_row(str(result.episode + 1), *_cells(figures([result])))
    if len(results) > 1:
        table.add_row("all", *_cells(figures(results)), style="bold")
    return table


def _cells(figure: dict[str, object]) -> list[str]:
    counts = ("objects", "cleared", "picks", "succeeded", "dropped", "looks")
    numbers = (
        ("median_rotation_deg", ".2f"),
        ("median_translation_mm", ".2f"),
        ("simulated_time", ".1f"),
        ("wall_time", ".1f"),
        ("picks_per_hour", ".0f"),
        ("real_time_factor", ".2f"),
    )
    return [str(figure[name]) for name in counts] + [
        "-" if figure[name] is None else format(figure[name], spec)
        for name, spec in numbers
    ]
