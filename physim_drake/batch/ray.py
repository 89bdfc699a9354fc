# SPDX-License-Identifier: MIT
"""Estimating on a Ray cluster: many scenes at once, each on one processor."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial

from physim_drake.closing import Closing
from physim_drake.errors import InputError
from physim_drake.estimation.config import EstimationConfig
from physim_drake.estimation.estimator import PoseEstimator
from physim_drake.estimation.preparation import EstimationRequest
from physim_drake.objects.model import ObjectLibrary
from physim_drake.parallel.engine import Engine
from physim_drake.parallel.ray_pool import RayPool, in_order
from physim_drake.scene_estimate import SceneEstimate


class RayEstimator(Closing):
    """Estimates scenes on the machines of a Ray cluster, one on each processor.

    Args:
        library: the objects that may occur.
        config: settings of each `PoseEstimator`; `workers` is not used.
    """

    def __init__(self, library: ObjectLibrary, config: EstimationConfig) -> None:
        alone = replace(config, workers=1)
        self._pool = RayPool(partial(_RemoteEstimator, library, alone))

    def estimate_all(
        self, requests: Iterable[EstimationRequest]
    ) -> Iterator[SceneEstimate]:
        """Estimates many scenes at once; gives them in the order of the requests."""
        for answer in self.attempt_all(requests):
            if isinstance(answer, InputError):
                raise answer
            yield answer

    def attempt_all(
        self, requests: Iterable[EstimationRequest]
    ) -> Iterator[SceneEstimate | InputError]:
        """As `estimate_all`, but a request that fails gives its error in its turn."""
        answers: Iterator[tuple[int, SceneEstimate | InputError]] = self._pool.stream(
            _RemoteEstimator.estimate.__name__, ((request,) for request in requests)
        )
        yield from in_order(answers)

    def close(self) -> None:
        """Gives up the processes."""
        self._pool.close()


class _RemoteEstimator:
    """A `PoseEstimator` in a process of a cluster."""

    def __init__(self, library: ObjectLibrary, config: EstimationConfig) -> None:
        self._estimator = PoseEstimator(library, config)

    def estimate(self, request: EstimationRequest) -> SceneEstimate | InputError:
        """An error is also an answer: those to earlier requests come before it."""
        try:
            (estimate,) = self._estimator.estimate_all([request])
            return estimate
        except InputError as error:
            return error


Estimator = PoseEstimator | RayEstimator


def attempt_all(
    estimator: Estimator, requests: Iterable[EstimationRequest]
) -> Iterator[SceneEstimate | InputError]:
    """Estimates many scenes; one that cannot be used gives its error in its turn."""
    if isinstance(estimator, RayEstimator):
        yield from estimator.attempt_all(requests)
        return
    for request in requests:
        try:
            (answer,) = estimator.estimate_all([request])
        except InputError as error:
            yield error
        else:
            yield answer


def make_estimator(
    engine: Engine, library: ObjectLibrary, config: EstimationConfig
) -> Estimator:
    """The estimator for an engine.

    Raises:
        InputError: if the engine is Ray and that is not installed, or its cluster
            does not answer.
    """
    if engine is Engine.RAY:
        return RayEstimator(library, config)
    return PoseEstimator(library, config)
