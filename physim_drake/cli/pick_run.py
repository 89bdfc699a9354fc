# SPDX-License-Identifier: MIT
"""One run of `physim-drake pick`: the episodes, their replays, how it goes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context
from rich.console import Console

from physim_drake.cli.progress import Steps
from physim_drake.episodes.notes import EpisodeNotes
from physim_drake.episodes.result import EpisodeResult
from physim_drake.episodes.runner import EpisodeRunner
from physim_drake.errors import InputError
from physim_drake.picking.scenario import PickScenario
from physim_drake.reporting.replays import replay_page
from physim_drake.storage.files import write_atomically
from physim_drake.systems.pick_cell import PickCell, PickCellParts


class PickRun:
    """One call of the command.

    Args:
        scenario: what happens in the episodes.
        source: the scenario's file.
        notes: the episodes that are done.
        record: where replays go, if anywhere.
        meshcat: where the episodes are shown; must be where there are replays.
    """

    def __init__(
        self,
        scenario: PickScenario,
        source: Path,
        notes: EpisodeNotes,
        record: Path | None = None,
        meshcat: Meshcat | None = None,
    ) -> None:
        self._scenario, self._source, self._notes = scenario, source, notes
        self._record, self._meshcat = record, meshcat

    def run(self, count: int, console: Console) -> list[EpisodeResult]:
        """Runs those of so many episodes that are not done; returns all of them.

        Raises:
            InputError: where the scenario cannot work, or files cannot be written.
        """
        todo = [number for number in range(count) if not self._is_done(number)]
        with Steps(console, "episode", count) as steps:
            steps.begin(count - len(todo))
            if todo:
                with self._said_of_the_scenario():
                    parts = PickCellParts(meshcat=self._meshcat)
                    runner = EpisodeRunner(self._scenario, parts)
                with runner:
                    for done, number in enumerate(todo, count - len(todo)):
                        self._run(runner, number, count, steps, done)
        return [self._notes.results[number] for number in range(count)]

    def _is_done(self, number: int) -> bool:
        """Whether there is everything that is kept of an episode."""
        replay = self._record is None or (self._record / replay_name(number)).exists()
        return replay and number in self._notes.results

    def _run(
        self, runner: EpisodeRunner, number: int, count: int, steps: Steps, done: int
    ) -> None:
        """One episode; how far it is, then a line about it."""

        def show(cell: PickCell, context: Context) -> None:
            phase = cell.task.task_state(cell.task.GetMyContextFromRoot(context)).phase
            steps.reach(done, f"{context.get_time():.1f} s, {phase}")

        with self._said_of_the_scenario():
            result = runner.run(number, show)
        if self._meshcat is not None and self._record is not None:
            with write_atomically(self._record / replay_name(number)) as file:
                file.write(replay_page(self._meshcat))
        # Last, so that --resume makes up for a replay that was cut off.
        self._notes.add(result)
        steps.say(
            f"episode {number + 1} of {count}: {result.cleared} of "
            f"{len(result.objects)} objects cleared, {result.simulated:.0f} s "
            f"simulated in {result.wall:.0f} s; {result.end}"
        )
        steps.reach(done + 1)

    @contextmanager
    def _said_of_the_scenario(self) -> Iterator[None]:
        """Says of the scenario's file what is wrong with what it asks for."""
        try:
            yield
        except InputError as error:
            raise error.about(self._source) from error


def replay_name(number: int) -> str:
    """The file of an episode's replay, in the folder of the report."""
    return f"replay-{number + 1:03d}.html"
