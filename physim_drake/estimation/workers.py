# SPDX-License-Identifier: MIT
"""Worker processes that keep their renderer, plants and tables warm between images.

A `Worker` does all the computing on one scene at a time. A `WorkerPool` has several in
processes of their own, or one in this process, and gives every call's results in the
order of its arguments, so that what is computed does not depend on how many there are.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar, TypeVarTuple

import numpy as np
from threadpoolctl import threadpool_limits

from physim_drake.closing import Closing
from physim_drake.estimation.ambiguity import same_pose
from physim_drake.hypotheses.generation import (
    HypothesisConfig,
    PoseHypotheses,
    generate_hypotheses,
)
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.segmented_scene import SegmentedScene
from physim_drake.parallel.supervised_pool import SupervisedPool, SupervisionConfig
from physim_drake.poses import Array
from physim_drake.rendering.raster import DepthRasterizer
from physim_drake.search.expansion import Rollout, RolloutResult, SceneExpander
from physim_drake.search.refinement import JointRefiner, RefinementConfig
from physim_drake.search.states import ExpansionConfig, Placement

_Arguments = TypeVarTuple("_Arguments")
_Result = TypeVar("_Result")

# Drake's diagrams refer to themselves, so that only the collector frees them. It counts
# objects, not bytes: left to itself, it lets tens of megabytes of them gather.
_COLLECT_EVERY = 10  # scenes


@dataclass(frozen=True)
class WorkerConfig:
    """Settings of the steps that run in workers, and of what is done when one fails."""

    hypotheses: HypothesisConfig = field(default_factory=HypothesisConfig)
    expansion: ExpansionConfig = field(default_factory=ExpansionConfig)
    refinement: RefinementConfig = field(default_factory=RefinementConfig)
    supervision: SupervisionConfig = field(default_factory=SupervisionConfig)


class Worker:
    """Computes on one scene at a time.

    What a call gives depends on the scene and its arguments alone, not on earlier
    calls, so that any worker can make it, and make it again.

    Args:
        library: the objects that scenes may hold.
        config: settings of the steps that a worker computes.
    """

    def __init__(self, library: ObjectLibrary, config: WorkerConfig) -> None:
        self._library, self._config = library, config
        self._expander: SceneExpander | None = None
        self._joint_refiner: JointRefiner | None = None
        self._scenes = 0

    def set_scene(self, scene: SegmentedScene) -> None:
        """Makes `scene` the one that the other calls are about."""
        self._expander = self._joint_refiner = None
        self._scenes += 1
        if self._scenes % _COLLECT_EVERY == 0:
            gc.collect()
        renderer = DepthRasterizer(self._library, scene.intrinsics)
        self._expander = SceneExpander(
            scene, self._library, renderer, self._config.expansion
        )
        self._joint_refiner = JointRefiner(
            self._expander.renderer, self._expander.models, self._config.refinement
        )

    @property
    def expander(self) -> SceneExpander:
        """Of the current scene."""
        assert self._expander is not None, "set_scene comes first"
        return self._expander

    def hypotheses(
        self, index: int, others: Placement, seed: Sequence[int]
    ) -> PoseHypotheses:
        """Hypotheses of object `index`, from points that `others` do not explain."""
        return generate_hypotheses(
            self.expander.models[index],
            self.expander.scene,
            *self.expander.resegment(others, index),
            np.random.default_rng(list(seed)),
            self._config.hypotheses,
        )

    def rollout(self, rollout: Rollout) -> RolloutResult:
        """Places and scores the objects of one rollout."""
        return self.expander.run(rollout)

    def refine(self, placed: Placement) -> tuple[dict[int, Array], float]:
        """The state refined jointly, and its fine cost in pixels."""
        refiner = self._refiner()
        refined = refiner.refine(placed)
        return refined, refiner.fine_cost(refined)

    def other_ways(
        self, placed: Placement, index: int, poses: Array
    ) -> list[tuple[Placement, float]]:
        """The states with one object in another pose, and their fine costs in pixels.

        Args:
            placed: the state.
            index: index of the object.
            poses: X_SO (N, 4, 4) to begin at, beside the object turned over.

        Returns:
            the states, the least cost first, none with a pose that an earlier one or
            `placed` has.
        """
        refiner, model = self._refiner(), self.expander.models[index]
        ways = [
            (state, refiner.fine_cost(state))
            for X_SO in self.expander.other_ways(placed, index, poses)
            for state in [{**placed, index: X_SO}]
        ]
        known = [placed[index]]
        others: list[tuple[Placement, float]] = []
        for state, cost in sorted(ways, key=lambda way: way[1]):
            if not any(same_pose(model, state[index], X_SO) for X_SO in known):
                known.append(state[index])
                others.append((state, cost))
        return others

    def unrest(self, placed: Placement) -> float:
        """How far a state is from resting, m."""
        return self.expander.unrest(placed)

    def confidences(self, placed: Placement) -> dict[int, float]:
        """How well each placed object is confirmed by the image, 0..1."""
        confirmed = self.expander.renderer.confirmations(placed)
        return {k: confirmation.confidence for k, confirmation in confirmed.items()}

    def _refiner(self) -> JointRefiner:
        assert self._joint_refiner is not None, "set_scene comes first"
        return self._joint_refiner


class WorkerPool(Closing):
    """Runs a `Worker`'s methods on many arguments at once.

    Args:
        library: the objects that scenes may hold.
        config: settings of the steps, and of what is done when a process fails.
        workers: number of processes; 1 computes in this process and retries nothing.

    Use it as a context manager, or call `close`.
    """

    def __init__(
        self, library: ObjectLibrary, config: WorkerConfig, workers: int = 1
    ) -> None:
        self._local = Worker(library, config) if workers == 1 else None
        self._processes: SupervisedPool | None = None
        if workers > 1:
            make = partial(_make_worker, library, config)
            self._processes = SupervisedPool(make, workers, config.supervision)

    @property
    def pids(self) -> list[int]:
        """Ids of the worker processes at the moment; none if this one computes."""
        return [] if self._processes is None else self._processes.pids

    def set_scene(self, scene: SegmentedScene) -> None:
        """Sends `scene` to every worker.

        Raises:
            PhysimError: see `map`.
        """
        if self._processes is not None:
            self._processes.setup("set_scene", scene)
            return
        with threadpool_limits(1):
            self._worker.set_scene(scene)

    def map(
        self,
        method: Callable[[Worker, *_Arguments], _Result],
        arguments: Sequence[tuple[*_Arguments]],
    ) -> list[_Result]:
        """Calls a `Worker`'s method once with each tuple of arguments.

        A worker process that dies or hangs is replaced, and its call made again.

        Args:
            method: method of the class, as in `pool.map(Worker.refine, [(state,)])`.
            arguments: arguments of each call.

        Returns:
            the results, in the order of the arguments.

        Raises:
            PhysimError: what a call raised, or that one was made too often in vain.
        """
        if self._processes is not None:
            return self._processes.map(method.__name__, arguments)
        with threadpool_limits(1):
            return [method(self._worker, *args) for args in arguments]

    def one(
        self, method: Callable[[Worker, *_Arguments], _Result], *arguments: *_Arguments
    ) -> _Result:
        """Calls a `Worker`'s method once; see `map`."""
        return self.map(method, [arguments])[0]

    @property
    def _worker(self) -> Worker:
        assert self._local is not None, "there are processes"
        return self._local

    def close(self) -> None:
        """Ends the worker processes."""
        if self._processes is not None:
            self._processes.close()


def _make_worker(library: ObjectLibrary, config: WorkerConfig) -> Worker:
    """A worker in a process of its own, which computes in one thread."""
    threadpool_limits(1)
    return Worker(library, config)
