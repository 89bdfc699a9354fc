# SPDX-License-Identifier: MIT
from __future__ import annotations

import gc
import itertools
import os
import pickle
import signal
import threading
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant

from physim_drake.errors import InputError
from physim_drake.estimation.ambiguity import same_pose
from physim_drake.estimation.workers import Worker, WorkerConfig, WorkerPool
from physim_drake.hypotheses.generation import HypothesisConfig
from physim_drake.hypotheses.super4pcs import Super4PcsConfig
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.observation import Detection
from physim_drake.observation.segmented_scene import SegmentedScene
from physim_drake.poses import make_pose
from physim_drake.search.expansion import Rollout
from physim_drake.search.states import Placement
from tests.parallel.test_supervised_pool import alive
from tests.synthetic import (
    ERASER,
    SOAP,
    SyntheticScene,
    library,
    perturbed,
    stack,
    synthesize,
    turned,
)

CONFIG = WorkerConfig(
    hypotheses=HypothesisConfig(
        super4pcs=Super4PcsConfig(hypotheses=1000), polished=100
    )
)


@cache
def made() -> SyntheticScene:
    return synthesize(stack())


def small_library() -> ObjectLibrary:
    return ObjectLibrary([library()[k] for k in (ERASER, SOAP)], "small")


def scene_of(object_id: int) -> SegmentedScene:
    """The scene, its first segment said to be of another object."""
    first, second = made().detections
    detections = (Detection(object_id, first.box), second)
    return replace(made(), detections=detections).scene()


@pytest.fixture(scope="module")
def local() -> Iterator[WorkerPool]:
    with WorkerPool(small_library(), CONFIG, 1) as pool:
        pool.set_scene(made().scene())
        yield pool


@pytest.fixture(scope="module")
def two() -> Iterator[WorkerPool]:
    with WorkerPool(small_library(), CONFIG, 2) as pool:
        pool.set_scene(made().scene())
        yield pool


def rollouts(count: int) -> list[tuple[Rollout]]:
    return [
        (
            Rollout(
                ((0, made().X_SO[0]),),
                ((1, perturbed(made().X_SO[1], 0.004 * n, 0.03 * n, n)),),
            ),
        )
        for n in range(count)
    ]


def run_all(pool: WorkerPool, count: int = 7) -> list[tuple[bytes, int]]:
    results = pool.map(Worker.rollout, rollouts(count))
    return [(result.poses[0].tobytes(), result.score) for result in results]


def test_two_workers_give_the_results_of_one_in_order(
    local: WorkerPool, two: WorkerPool
) -> None:
    expected = run_all(local)
    assert run_all(two) == expected
    assert len(set(expected)) > 1
    assert run_all(two) == expected


def test_hypotheses_are_the_same_in_any_worker(
    local: WorkerPool, two: WorkerPool
) -> None:
    nothing: Placement = {}
    arguments = [(k, nothing, (5, 0, k)) for k in (1, 0, 1)]
    one = local.map(Worker.hypotheses, arguments)
    other = two.map(Worker.hypotheses, arguments)
    for a, b in zip(one, other, strict=True):
        assert a.X_SO.tobytes() == b.X_SO.tobytes()
        assert a.representatives.tolist() == b.representatives.tolist()
    assert [h.object_id for h in other] == [SOAP, ERASER, SOAP]


def test_refinement_is_the_same_in_any_worker(
    local: WorkerPool, two: WorkerPool
) -> None:
    states = [
        ({k: perturbed(X, 0.003, 0.03, 3 * n + k) for k, X in enumerate(made().X_SO)},)
        for n in range(3)
    ]
    for (a, cost_a), (b, cost_b) in zip(
        local.map(Worker.refine, states), two.map(Worker.refine, states), strict=True
    ):
        assert cost_a == cost_b
        assert all(a[k].tobytes() == b[k].tobytes() for k in a)


def test_other_ways_differ_from_the_state_and_each_other_the_best_first(
    local: WorkerPool,
) -> None:
    state = dict(enumerate(made().X_SO))
    upright = state[1] @ make_pose(turned("x", 90))
    starts = np.stack([perturbed(X, 0.002, 0.02, 0) for X in (state[1], upright)])
    (ways,) = local.map(Worker.other_ways, [(state, 1, np.tile(starts, (2, 1, 1)))])
    costs = [cost for _, cost in ways]
    assert costs == sorted(costs)
    model = small_library()[made().detections[1].object_id]
    poses = [state[1], *(way[1] for way, _ in ways)]
    for a, b in itertools.combinations(poses, 2):
        assert not same_pose(model, a, b)
    assert any(same_pose(model, pose, upright) for pose in poses)
    assert all(way[0] is state[0] for way, _ in ways)


@pytest.mark.parametrize("workers", ["local", "two"])
def test_nothing_to_do_gives_nothing(
    workers: str, request: pytest.FixtureRequest
) -> None:
    assert request.getfixturevalue(workers).map(Worker.rollout, []) == []


@pytest.mark.parametrize("workers", ["local", "two"])
def test_a_user_s_error_arrives_and_the_pool_goes_on(
    workers: str, request: pytest.FixtureRequest
) -> None:
    pool: WorkerPool = request.getfixturevalue(workers)
    before = run_all(pool, 3)
    with pytest.raises(InputError, match="small: has no object with id 99") as caught:
        pool.set_scene(scene_of(99))
    assert caught.value.problem == "has no object with id 99"
    assert "it has 2, 9" in caught.value.remedy
    # The next image is estimated as if nothing had happened.
    pool.set_scene(made().scene())
    assert run_all(pool, 3) == before


def test_a_defect_in_one_call_does_not_mix_up_the_next(two: WorkerPool) -> None:
    before = run_all(two, 4)
    broken: Any = [("no rollout",), *rollouts(5)]
    with pytest.raises(RuntimeError, match="AttributeError"):
        two.map(Worker.rollout, broken)
    assert run_all(two, 4) == before


def test_a_worker_that_dies_is_replaced_and_nothing_changes(
    local: WorkerPool,
) -> None:
    """The one that replaces it has the scene, and gives the very same bytes."""
    expected = run_all(local, 12)
    with WorkerPool(small_library(), CONFIG, 2) as pool:
        pool.set_scene(made().scene())
        before = pool.pids
        killer = threading.Timer(0.02, os.kill, (before[0], signal.SIGKILL))
        killer.start()
        assert run_all(pool, 12) == expected
        killer.join()
        os.kill(before[1], signal.SIGKILL)  # idle
        assert run_all(pool, 12) == expected
        assert not set(before) & set(pool.pids)


def test_a_call_gives_the_same_in_a_fresh_worker_as_in_a_used_one() -> None:
    """Settlers, models and tables that are kept from call to call change nothing."""
    used = Worker(small_library(), CONFIG)
    used.set_scene(made().scene())
    calls = rollouts(5)
    first = [used.rollout(*call) for call in calls]
    used.unrest(dict(enumerate(made().X_SO)))
    used.hypotheses(0, {}, (1, 2, 3))
    again = [used.rollout(*call) for call in reversed(calls)][::-1]
    for call, a, b in zip(calls, first, again, strict=True):
        fresh = Worker(small_library(), CONFIG)
        fresh.set_scene(made().scene())
        c = fresh.rollout(*call)
        assert a.score == b.score == c.score
        assert a.poses[0].tobytes() == b.poses[0].tobytes() == c.poses[0].tobytes()


def test_what_a_scene_needed_does_not_gather() -> None:
    """A plant refers to itself; the collector, which is off here, alone frees it."""
    before = count(MultibodyPlant)
    gc.disable()
    try:
        worker = Worker(small_library(), CONFIG)
        for _ in range(25):
            worker.set_scene(made().scene())
            worker.rollout(*rollouts(1)[0])
        assert count(MultibodyPlant) - before < 2 * 10
    finally:
        gc.enable()


def count(kind: type) -> int:
    """How many objects of a kind there are."""
    return sum(type(item) is kind for item in gc.get_objects())


def test_close_ends_the_processes() -> None:
    pool = WorkerPool(small_library(), CONFIG, 2)
    pids = pool.pids
    assert all(alive(pid) for pid in pids)
    pool.close()
    assert not any(alive(pid) for pid in pids)
    pool.close()


def test_errors_survive_the_journey() -> None:
    error = InputError(Path("models") / "x.obj", "is empty", "export it", "faces")
    sent = pickle.loads(pickle.dumps(error))
    assert type(sent) is InputError
    assert str(sent) == str(error)
    assert (sent.source, sent.problem, sent.remedy, sent.field) == (
        error.source,
        error.problem,
        error.remedy,
        error.field,
    )


def test_a_sent_library_still_has_its_objects() -> None:
    sent = pickle.loads(pickle.dumps(small_library()))
    assert sent.ids == (ERASER, SOAP)
    np.testing.assert_array_equal(
        sent[SOAP].mesh.vertices, library()[SOAP].mesh.vertices
    )
