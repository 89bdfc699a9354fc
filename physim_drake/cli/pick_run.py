# SPDX-License-Identifier: MIT
"""One run of `physim-drake pick`: the episodes, their replays, how it goes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context
from rich.console import Console

from physim_drake.cli.output import counted
from physim_drake.cli.progress import Steps
from physim_drake.episodes.notes import EpisodeNotes
from physim_drake.episodes.result import EpisodeResult
from physim_drake.episodes.runner import EpisodeRunner
from physim_drake.errors import InputError
from physim_drake.picking.scenario import PickScenario
from physim_drake.reporting.replays import replay_page
from physim_drake.storage.files import write_atomically
from physim_drake.systems.pick_cell import PickCell, PickCellParts


@dataclass(frozen=True)
class PickJob:
    """What one call of the command runs.

    Attributes:
        scenario: cell, objects and task of the episodes.
        source: file of the scenario, as errors name it.
        episodes: number of episodes.
        record: folder for replays, if any are wanted.
        meshcat: viewer of the episodes; replays need one.
    """

    scenario: PickScenario
    source: Path
    episodes: int
    record: Path | None = None
    meshcat: Meshcat | None = None


def run_episodes(
    job: PickJob, notes: EpisodeNotes, console: Console
) -> list[EpisodeResult]:
    """Runs those episodes that are not done; returns the results of all of them.

    Args:
        job: the episodes.
        notes: results of the episodes that are done, which those run now join.
        console: output for how far it is.

    Raises:
        InputError: if the scenario cannot work, or files cannot be written.
    """
    todo = [n for n in range(job.episodes) if not _is_done(job, notes, n)]
    with Steps(console, "episode", job.episodes) as steps:
        steps.begin(job.episodes - len(todo))
        if todo:
            with _said_of(job.source):
                runner = EpisodeRunner(job.scenario, PickCellParts(meshcat=job.meshcat))
            with runner:
                for done, number in enumerate(todo, job.episodes - len(todo)):
                    result = _run_episode(job, runner, number, steps, done)
                    # Last, so that --resume makes up for a replay that was cut off.
                    notes.add(result)
                    steps.say(_summary(result, job.episodes))
                    steps.reach(done + 1)
    return [notes.results[number] for number in range(job.episodes)]


def _is_done(job: PickJob, notes: EpisodeNotes, number: int) -> bool:
    """Whether there is everything that is kept of an episode."""
    replay = job.record is None or (job.record / replay_name(number)).exists()
    return replay and number in notes.results


def _run_episode(
    job: PickJob, runner: EpisodeRunner, number: int, steps: Steps, done: int
) -> EpisodeResult:
    """Runs one episode, shows how far it is and writes its replay."""

    def show(cell: PickCell, context: Context) -> None:
        phase = cell.task.task_state(cell.task.GetMyContextFromRoot(context)).phase
        steps.reach(done, f"{context.get_time():.1f} s, {phase}")

    with _said_of(job.source):
        result = runner.run(number, show)
    if job.meshcat is not None and job.record is not None:
        with write_atomically(job.record / replay_name(number)) as file:
            file.write(replay_page(job.meshcat))
    return result


def _summary(result: EpisodeResult, episodes: int) -> str:
    return (
        f"episode {result.episode + 1} of {episodes}: {result.cleared} of "
        f"{counted(len(result.objects), 'object')} cleared, "
        f"{result.simulated:.0f} s simulated in {result.wall:.0f} s; {result.end}"
    )


@contextmanager
def _said_of(source: Path) -> Iterator[None]:
    """Says of the scenario's file what is wrong with what it asks for."""
    try:
        yield
    except InputError as error:
        raise error.about(source) from error


def replay_name(number: int) -> str:
    """The file of an episode's replay, in the folder of the report."""
    return f"replay-{number + 1:03d}.html"
