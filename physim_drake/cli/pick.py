# SPDX-License-Identifier: MIT
"""`physim-drake pick`: let the pick cell clear its table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from physim_drake.cli.options import (
    JsonFile,
    LogLevel,
    Quiet,
    Resume,
)
from physim_drake.cli.output import LogLevelName, counted, messages, output_json
from physim_drake.errors import InputError
from physim_drake.extras import need_extra
from physim_drake.picking.detector_name import DetectorName

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from physim_drake.episodes.result import EpisodeResult
    from physim_drake.picking.scenario import PickScenario

PROGRESS_FILE = "pick.progress"
"""Keeps the episodes that are done, in the report's folder."""


def pick(
    scenario: Annotated[
        Path, typer.Argument(help="YAML file of the cell, its objects and its task.")
    ],
    seed: Annotated[
        int | None,
        typer.Option(
            min=0, help="Seed of all random choices.", show_default="the scenario's"
        ),
    ] = None,
    episodes: Annotated[
        int, typer.Option(min=1, help="Number of episodes, each with other objects.")
    ] = 1,
    detector: Annotated[
        DetectorName | None,
        typer.Option(
            help="What finds the objects in the images: a trained network, or an "
            "oracle that knows the truth.",
            show_default="the scenario's",
        ),
    ] = None,
    weights: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Weights of the network; physim-drake train writes them.",
            show_default="the scenario's",
        ),
    ] = None,
    meshcat: Annotated[
        bool,
        typer.Option(
            "--meshcat/--headless",
            help="Whether to show the cell in a browser, through Meshcat.",
        ),
    ] = False,
    host: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="The address at which Meshcat listens; * is every address.",
        ),
    ] = "localhost",
    record: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for a report with replays."),
    ] = None,
    json_file: JsonFile = None,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Number of processes that estimate; the figures do not depend on it.",
            show_default="the scenario's",
        ),
    ] = None,
    resume: Resume = False,
    quiet: Quiet = False,
    log_level: LogLevel = LogLevelName.WARNING,
) -> None:
    """Clear a table with a robot: look, estimate, plan, pick, place, look again.

    The robot, its gripper, its camera and the objects are simulated; what is picked is
    decided from estimated poses alone. Prints, by episode and over all: objects cleared
    into the tote; picks tried, succeeded and dropped; the median errors of the
    estimates; picks an hour; simulated time over wall time. With the same seed, all but
    the wall times come out the same.

    Each episode is kept at once in `DIR/pick.progress`, or in `FILE.progress` if only
    `--json` is given: a run that was cut off goes on with `--resume`.

    Example: `physim-drake pick examples/scenarios/clutter.yaml --episodes 10 --seed 0`
    """
    from contextlib import nullcontext

    if record is not None:
        need_extra("viz")

    from physim_drake.cli.pick_run import PickJob, replay_name, run_episodes
    from physim_drake.episodes.notes import EpisodeNotes, scenario_settings
    from physim_drake.episodes.result import summary
    from physim_drake.episodes.runner import local_meshcat
    from physim_drake.picking.scenario import load_scenario
    from physim_drake.storage.files import make_folder
    from physim_drake.storage.progress_file import ProgressFile

    loaded = _choose_detector(load_scenario(scenario), detector, weights)
    loaded = _with_options(loaded, seed, workers)
    kept = _progress_path(record, json_file, resume)
    if record is not None:
        make_folder(record)
    shown = local_meshcat(host) if meshcat or record is not None else None
    if meshcat and shown is not None:
        typer.echo(f"Meshcat: {shown.web_url()}", err=True)
    with (
        nullcontext()
        if kept is None
        else ProgressFile(kept, scenario_settings(loaded), record or kept)
    ) as progress:
        notes = EpisodeNotes(progress, progress.go_on(resume) if progress else ())
        job = PickJob(loaded, scenario, episodes, record, shown)
        results = run_episodes(job, notes, messages(quiet))
    if record is not None:
        from physim_drake.reporting.episodes_page import write_episodes_report

        replays = [replay_name(result.episode) for result in results]
        write_episodes_report(results, replays, str(loaded.random_seed), record)
    if json_file is None or not output_json(json_file, summary(results)):
        _print(results, record)


def _progress_path(
    record: Path | None, json_file: Path | None, resume: bool
) -> Path | None:
    """The file that keeps episodes, beside what is written at the end."""
    from physim_drake.storage.files import is_written_straight

    if record is not None:
        return record / PROGRESS_FILE
    if json_file is None or str(json_file) == "-" or is_written_straight(json_file):
        if resume:
            raise InputError(
                "--resume",
                "goes on with what --record or --json kept",
                "give --record DIR or --json FILE, the same as before",
            )
        return None
    return json_file.with_name(f"{json_file.name}.progress")


def _with_options(
    scenario: PickScenario, seed: int | None, workers: int | None
) -> PickScenario:
    from dataclasses import replace

    if seed is not None:
        scenario = replace(scenario, random_seed=seed)
    if workers is not None:
        scenario = replace(scenario, look=replace(scenario.look, workers=workers))
    return scenario


def _choose_detector(
    scenario: PickScenario, detector: DetectorName | None, weights: Path | None
) -> PickScenario:
    from dataclasses import replace

    look = scenario.look
    if detector is not None:
        look = replace(look, detector=detector)
    if weights is not None:
        if look.detector is DetectorName.ORACLE:
            raise InputError(
                "--weights", "given with an oracle", "give --detector network"
            )
        look = replace(look, weights=str(weights))
    return replace(scenario, look=look)


def _print(results: Sequence[EpisodeResult], record: Path | None) -> None:
    """A table of the episodes, why objects were left, and what to open."""
    from rich.console import Console

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
    console.print(_closing(results, record), soft_wrap=True)


def _closing(results: Sequence[EpisodeResult], record: Path | None) -> str:
    """The outcome in a sentence, and the page to open if there is one."""
    cleared = sum(result.cleared for result in results)
    objects = counted(sum(len(result.objects) for result in results), "object")
    text = f"The robot cleared {cleared} of {objects} in "
    text += f"{counted(len(results), 'episode')}."
    return text if record is None else f"{text} Open {record / 'index.html'}"


def _table(results: Sequence[EpisodeResult]) -> Table:
    from rich import box
    from rich.table import Table

    from physim_drake.episodes.result import figures

    table = Table(box=box.SIMPLE_HEAD, padding=0, pad_edge=False)
    table.add_column("episode")
    for header in (
        "objects",
        "cleared",
        "picks",
        "picked",
        "dropped",
        "looks",
        "rot.\ndeg",
        "dist.\nmm",
        "sim.\ntime s",
        "wall\ntime s",
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
