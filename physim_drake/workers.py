# SPDX-License-Identifier: MIT
"""Worker processes that keep their renderer, plants and tables warm between images.

A `Worker` does all the computing on one scene at a time. A `WorkerPool` has several in
processes of their own, or one in this process, and gives every call's results in the
order of its arguments, so that what is computed does not depend on how many there are.
"""

from __future__ import annotations

import multiprocessing
import os
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from types import TracebackType
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from physim_drake.errors import PhysimError
from physim_drake.hypotheses.generation import (
    HypothesisConfig,
    PoseHypotheses,
    generate_hypotheses,
)
from physim_drake.objects import ObjectLibrary
from physim_drake.poses import Array
from physim_drake.rendering.raster import DepthRasterizer
from physim_drake.scene import Scene
from physim_drake.search.expansion import Rollout, RolloutResult, SceneExpander
from physim_drake.search.refinement import JointRefiner, RefinementConfig
from physim_drake.search.states import ExpansionConfig, Placement


@dataclass(frozen=True)
class WorkerConfig:
    """Settings of the steps that run in workers."""

    hypotheses: HypothesisConfig = field(default_factory=HypothesisConfig)
    expansion: ExpansionConfig = field(default_factory=ExpansionConfig)
    refinement: RefinementConfig = field(default_factory=RefinementConfig)


class Worker:
    """Computes on one scene at a time.

    Args:
        library: the objects that scenes may hold.
        config: settings of the steps.
    """

    def __init__(self, library: ObjectLibrary, config: WorkerConfig) -> None:
        self._library, self._config = library, config
        self._expander: SceneExpander | None = None
        self._joint_refiner: JointRefiner | None = None

    def set_scene(self, scene: Scene) -> None:
        """Makes `scene` the one that the other calls are about."""
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

    def turned(self, placed: Placement, index: int) -> list[tuple[Placement, float]]:
        """The states with one object turned over, and their fine costs in pixels."""
        refiner = self._refiner()
        return [
            (state, refiner.fine_cost(state))
            for state in self.expander.turned(placed, index)
        ]

    def unrest(self, placed: Placement) -> float:
        """How far a state is from resting, m."""
        return self.expander.unrest(placed)

    def confidences(self, placed: Placement) -> dict[int, float]:
        """How well each placed object is confirmed by the image, 0..1."""
        return self.expander.renderer.confidences(placed)

    def _refiner(self) -> JointRefiner:
        assert self._joint_refiner is not None, "set_scene comes first"
        return self._joint_refiner


class WorkerPool:
    """Runs a `Worker`'s methods on many arguments at once.

    Args:
        library: see `Worker`.
        config: see `Worker`.
        workers: processes; 1 computes in this process.

    Use it as a context manager, or call `close`.
    """

    def __init__(
        self, library: ObjectLibrary, config: WorkerConfig, workers: int = 1
    ) -> None:
        self._local = Worker(library, config) if workers == 1 else None
        self._links: list[Connection] = []
        self._processes: list[multiprocessing.process.BaseProcess] = []
        if workers > 1:
            context = multiprocessing.get_context("spawn")
            for _ in range(workers):
                ours, theirs = context.Pipe()
                process = context.Process(
                    target=_serve, args=(theirs, library, config), daemon=True
                )
                process.start()
                theirs.close()
                self._links.append(ours)
                self._processes.append(process)

    def set_scene(self, scene: Scene) -> None:
        """Sends `scene` to every worker."""
        if self._local:
            with threadpool_limits(1):
                self._local.set_scene(scene)
            return
        for link in self._open_links():
            self._send(link, "set_scene", (scene,))
        # All replies are fetched before any of them may raise: one left behind would
        # be taken for the reply to the next call.
        replies = [self._receive(link) for link in self._links]
        for reply in replies:
            _unwrap(reply)

    def map(self, method: str, arguments: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Calls a `Worker`'s method once with each tuple of arguments.

        Returns:
            the results, in the order of the arguments.

        Raises:
            PhysimError: what a call raised, or that a worker died.
        """
        if self._local:
            with threadpool_limits(1):
                return [getattr(self._local, method)(*args) for args in arguments]
        links = self._open_links()
        replies: list[tuple[str, Any] | None] = [None] * len(arguments)
        todo = iter(enumerate(arguments))
        busy: dict[Connection, int] = {}
        for link, (index, args) in zip(links, todo, strict=False):
            self._send(link, method, args)
            busy[link] = index
        failed = False
        while busy:
            ready: list[Any] = wait(list(busy))
            for link in ready:
                reply = replies[busy.pop(link)] = self._receive(link)
                failed = failed or reply[0] != "result"
                following = None if failed else next(todo, None)
                if following is not None:
                    self._send(link, method, following[1])
                    busy[link] = following[0]
        return [_unwrap(reply) for reply in replies if reply is not None]

    def _open_links(self) -> list[Connection]:
        if not self._links:
            raise PhysimError("the worker processes have ended; make a new pool")
        return self._links

    def _send(self, link: Connection, method: str, args: tuple[Any, ...]) -> None:
        try:
            link.send((method, args))
        except OSError as error:
            raise self._died() from error

    def _receive(self, link: Connection) -> tuple[str, Any]:
        try:
            reply: tuple[str, Any] = link.recv()
        except (EOFError, OSError) as error:
            raise self._died() from error
        return reply

    def _died(self) -> PhysimError:
        """Ends the others too: replies of theirs may be on their way."""
        self.close()
        return PhysimError("a worker process died; see above for why")

    def close(self) -> None:
        """Ends the worker processes."""
        for link in self._links:
            link.close()
        for process in self._processes:
            process.join(timeout=2.0)
            if process.is_alive():
                process.terminate()
                process.join()
        self._links, self._processes = [], []

    def __enter__(self) -> WorkerPool:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _unwrap(reply: tuple[str, Any]) -> Any:
    """The result in a reply; raises the error in one."""
    kind, value = reply
    if kind == "error":
        raise value
    if kind == "crash":
        raise RuntimeError(f"in a worker:\n{value}")
    return value


def _serve(link: Connection, library: ObjectLibrary, config: WorkerConfig) -> None:
    """The life of a worker process."""
    os.environ["OMP_NUM_THREADS"] = "1"
    worker = Worker(library, config)
    with threadpool_limits(1):
        while True:
            try:
                method, args = link.recv()
            except (EOFError, KeyboardInterrupt):
                return
            try:
                reply = ("result", getattr(worker, method)(*args))
            except PhysimError as error:
                reply = ("error", error)
            except KeyboardInterrupt:
                return
            except Exception:
                reply = ("crash", traceback.format_exc())
            try:
                link.send(reply)
            except OSError:  # the pool was closed meanwhile
                return
