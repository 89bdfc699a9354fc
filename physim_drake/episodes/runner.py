# SPDX-License-Identifier: MIT
"""Runs episodes of a pick cell and judges them by the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from physim_drake.closing import Closing
from physim_drake.episodes.result import (
    EpisodeResult,
    LookOutcome,
    ObjectOutcome,
    reason_left,
)
from physim_drake.episodes.stopwatch import Stopwatch, TimedPlanner
from physim_drake.estimation.estimator import PoseEstimator
from physim_drake.objects.model import ObjectLibrary
from physim_drake.picking.cell import PickCellGeometry, prepare_cell
from physim_drake.picking.initial_scene import PlacedModel, draw_start
from physim_drake.picking.scenario import PickScenario
from physim_drake.picking.task_state import EventKind, Phase, TaskState
from physim_drake.poses import Array
from physim_drake.scenes.generation import write_models
from physim_drake.storage.scratch import ScratchFolder
from physim_drake.systems.look_system import LookSystem
from physim_drake.systems.pick_cell import (
    PickCell,
    PickCellParts,
    cell_network,
    perception_config,
)

_STEP = 0.1  # s, between looks at how far the task is
_AFTERWARDS = 1.0  # s, for what was let go last to come to rest
# Meshcat looks over the table's far corner at arm and objects; m, from the pick area.
_VIEW_FROM, _VIEW_OF = np.array([0.9, -0.8, 0.75]), np.array([-0.15, 0.1, 0.15])
_FALLEN = 0.05  # m below the pick area
_STAGES = {
    "camera": "rendering",
    "hypothesis_generator": "estimation",
    "pose_estimator": "estimation",
}
"""Under which stage the work of perception's systems is booked."""


class EpisodeRunner(Closing):
    """Runs episodes, and keeps planner and estimator warm from one to the next.

    Args:
        scenario: the cell and its task.
        parts: parts that replace the usual ones of each cell.

    Raises:
        InputError: if the scenario cannot work; see `prepare_cell`, `cell_network`.

    Use it as a context manager, or call `close`.
    """

    def __init__(
        self,
        scenario: PickScenario,
        parts: PickCellParts = PickCellParts(),  # noqa: B008 (frozen)
    ) -> None:
        self._cell = prepare_cell(scenario)
        self._watch = Stopwatch()
        # Read once, not for every episode.
        detector = parts.detector or cell_network(self._cell)
        self._folder = ScratchFolder()
        self._files = write_models(self.library, self._folder.path)
        self._own_estimator: PoseEstimator | None = None
        if parts.estimator is None:
            config = perception_config(self._cell, scenario.random_seed)
            self._own_estimator = PoseEstimator(
                self.library, config.estimator.estimation
            )
        self._parts = replace(
            parts,
            detector=detector,
            estimator=parts.estimator or self._own_estimator,
            planner=TimedPlanner(parts.planner or self.geometry.planner, self._watch),
        )

    @property
    def scenario(self) -> PickScenario:
        """The cell and its task."""
        return self._cell.scenario

    @property
    def library(self) -> ObjectLibrary:
        """The objects of the scenario."""
        return self._cell.library

    @property
    def geometry(self) -> PickCellGeometry:
        """Where things are in the cell."""
        return self._cell.geometry

    def run(
        self,
        episode: int,
        on_step: Callable[[PickCell, Context], None] = lambda _cell, _context: None,
    ) -> EpisodeResult:
        """Runs one episode. Its number and the scenario decide everything in it.

        Args:
            episode: number of the episode, from 0.
            on_step: called with the cell and its context every 0.1 s of simulated time.

        Raises:
            InputError: if no scene to begin with can be drawn.
        """
        watch = self._watch
        watch.restart()
        start = draw_start(
            self.scenario, self.library, self._files, self.geometry.X_WA, episode
        )
        seed = _seed(self.scenario.random_seed, episode)
        cell = PickCell(self._cell, start, seed, self._parts)
        self._time_perception(cell)
        watch.lap("set-up")
        judge = _Judge(cell)
        with self._recorded():
            state = self._simulate(cell, judge, on_step)
        watch.lap("simulation")
        in_tote = self.geometry.tote.holds
        return EpisodeResult(
            episode,
            _outcomes(cell, start, state, judge.truth(), in_tote),
            judge.looks(self._on_table),
            state.log,
            judge.time,
            watch.seconds,
        )

    def _time_perception(self, cell: PickCell) -> None:
        perception: Any = cell.perception
        for name, stage in _STAGES.items():
            if perception.HasSubsystemNamed(name):
                system: LookSystem = perception.GetSubsystemByName(name)
                system.time_work(partial(self._watch.stage, stage))

    @contextmanager
    def _recorded(self) -> Iterator[None]:
        """If there is a Meshcat, makes a replay of what happens meanwhile."""
        meshcat = self._parts.meshcat
        if meshcat is None:
            yield
            return
        middle = self.geometry.X_WA[:3, 3]
        eye, target = middle + _VIEW_FROM, middle + _VIEW_OF
        meshcat.SetCameraPose(eye, target)  # pyright: ignore[reportArgumentType]
        meshcat.StartRecording(set_visualizations_while_recording=True)
        yield
        meshcat.StopRecording()
        meshcat.PublishRecording()

    def _simulate(
        self,
        cell: PickCell,
        judge: _Judge,
        on_step: Callable[[PickCell, Context], None],
    ) -> TaskState:
        """Runs the task to its end and returns what it knows then."""
        simulator = Simulator(cell.diagram)
        context = simulator.get_mutable_context()
        judge.watch(context)
        end = self.scenario.max_duration
        try:
            simulator.Initialize()
            while judge.time < end:
                simulator.AdvanceTo(judge.time + _STEP)
                judge.take_down()
                on_step(cell, context)
                if judge.state.phase is Phase.DONE:
                    simulator.AdvanceTo(judge.time + _AFTERWARDS)
                    return judge.state
        except RuntimeError as error:  # Drake's solver or geometry gave up
            text = f"the simulation failed: {' '.join(str(error).split())[:200]}"
            return judge.state.noted(judge.time, EventKind.END, text)
        return judge.state.noted(
            judge.time, EventKind.END, f"{end:g} s are over, the task is not"
        )

    def _on_table(self, p_WO: Array) -> bool:
        """Whether an object at this point has yet to be picked, and can be."""
        fallen = p_WO[2] < self.geometry.X_WA[2, 3] - _FALLEN
        return not fallen and not self.geometry.tote.holds(p_WO)

    def close(self) -> None:
        """Ends worker processes and removes temporary files."""
        if self._own_estimator is not None:
            self._own_estimator.close()
        self._folder.close()


class _Judge:
    """Watches an episode from outside, with the truth at hand."""

    def __init__(self, cell: PickCell) -> None:
        self.cell = cell

    def watch(self, context: Context) -> None:
        """Begins with a simulator's context."""
        self._root = context
        self._task = self.cell.task.GetMyContextFromRoot(context)
        self._perception = self.cell.perception.GetMyContextFromRoot(context)
        self._truth_at: dict[int, dict[str, Array]] = {}

    @property
    def time(self) -> float:
        """Simulated, s."""
        return float(self._root.get_time())

    @property
    def state(self) -> TaskState:
        """What the task knows."""
        return self.cell.task.task_state(self._task)

    def truth(self) -> dict[str, Array]:
        """X_WO (4, 4) of every object."""
        truth: dict[str, Array] = self._port("true_poses")
        return truth

    def take_down(self) -> None:
        """Keeps where the objects were at the newest look."""
        look = self._port("look_poses")
        if look.number and look.value is not None:
            self._truth_at[look.number] = look.value

    def looks(self, on_table: Callable[[Array], bool]) -> tuple[LookOutcome, ...]:
        """All looks, with the errors for what was on the table."""
        outcomes = []
        for look in self._port("pose_errors").value or ():
            truth = self._truth_at.get(look.number, {})
            there = {n for n, X_WO in truth.items() if on_table(X_WO[:3, 3])}
            errors = tuple(e for e in look.objects if e.name in there)
            outcomes.append(LookOutcome(look.number, look.time, errors, look.error))
        return tuple(outcomes)

    def _port(self, name: str) -> Any:
        return self.cell.perception.GetOutputPort(name).Eval(self._perception)


def _outcomes(
    cell: PickCell,
    start: tuple[PlacedModel, ...],
    state: TaskState,
    truth: dict[str, Array],
    in_tote: Callable[[Array], bool],
) -> tuple[ObjectOutcome, ...]:
    outcomes = []
    for instance, model in zip(cell.instances, start, strict=True):
        cleared = in_tote(truth[instance.name][:3, 3])
        reason = "" if cleared else reason_left(instance.name, state.log)
        outcomes.append(ObjectOutcome(instance.name, model.level, cleared, reason))
    return tuple(outcomes)


def _seed(seed: int, episode: int) -> int:
    return int(np.random.SeedSequence([seed, episode]).generate_state(1)[0])


def local_meshcat(host: str = "localhost", port: int | None = None) -> Meshcat:
    """A Meshcat server that by default only this computer reaches.

    Args:
        host: the address to listen at; "*" for all.
        port: port to listen at; None for the first free one from 7000.
    """
    return Meshcat(MeshcatParams(host=host, port=port))
