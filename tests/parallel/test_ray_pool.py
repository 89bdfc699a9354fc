# SPDX-License-Identifier: MIT
"""On a cluster of two machines, both of them here, one of which is lost midway."""

from __future__ import annotations

import logging
import os
import signal
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from physim_drake.errors import InputError, PhysimError
from physim_drake.parallel.ray_pool import RayPool, in_order

ray = pytest.importorskip("ray", reason="Ray, an extra, is not installed")


class Workshop:
    """What is called: notes in a folder when it was made and what it does."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._machine = ray.get_runtime_context().get_node_id()
        (folder / f"made-{self._machine}-{os.getpid()}").touch()

    def square(self, n: int) -> int:
        return n * n

    def slow_square(self, n: int) -> int:
        name = f"begun-{self._machine}-{n}-{os.getpid()}"
        (self._folder / name).touch()
        time.sleep(1.0)
        return n * n

    def refuse(self, n: int) -> None:
        raise InputError("number", f"is {n}", "give another")

    def level(self) -> int:
        return logging.getLogger("physim_drake.x").getEffectiveLevel()

    def crash(self, n: int) -> None:
        os._exit(n)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    from ray.cluster_utils import Cluster

    machines = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    ray.init(address=machines.address, log_to_driver=False, logging_level="ERROR")
    yield machines
    ray.shutdown()
    machines.shutdown()


def test_results_come_in_order() -> None:
    results = iter([(1, "b"), (0, "a"), (3, "d"), (2, "c")])
    assert list(in_order(results)) == ["a", "b", "c", "d"]


def test_no_cluster_is_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ray's own would listen to the whole network."""

    def init(address: str | None = None, **_: object) -> None:
        assert address == "auto"
        raise ConnectionError("Could not find any running Ray instance.")

    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    monkeypatch.setattr(ray, "is_initialized", lambda: False)
    monkeypatch.setattr(ray, "init", init)
    with pytest.raises(InputError, match="no Ray cluster answers"):
        RayPool(dict)


def test_a_machine_is_lost_and_nothing_else(cluster: Any, tmp_path: Path) -> None:
    second = cluster.add_node(num_cpus=1)
    cluster.wait_for_nodes()
    done = {}
    with RayPool(partial(Workshop, tmp_path)) as pool:
        for n, value in pool.stream("slow_square", [(n,) for n in range(16)]):
            done[n] = value
            begun = [f.name.split("-") for f in tmp_path.glob("begun-*")]
            lost = [
                f for f in begun if f[1] == second.node_id and int(f[2]) not in done
            ]
            if lost and second in cluster.worker_nodes:
                for _, _, _, pid in lost:
                    os.kill(int(pid), signal.SIGKILL)
                cluster.remove_node(second, allow_graceful=False)
    assert second not in cluster.worker_nodes
    assert done == {n: n * n for n in range(16)}
    assert (
        len(list(tmp_path.glob("begun-*"))) > 16
    )  # what the lost machine was at was done again
    assert len(list(tmp_path.glob("made-*"))) <= 5  # not once a call


def test_what_a_call_raises_is_raised_here(cluster: Any, tmp_path: Path) -> None:
    with (
        RayPool(partial(Workshop, tmp_path)) as pool,
        pytest.raises(InputError, match="number: is 3; give another"),
    ):
        list(pool.stream("refuse", [(3,)]))


def test_a_call_that_ends_its_process_is_given_up(cluster: Any, tmp_path: Path) -> None:
    with (
        RayPool(partial(Workshop, tmp_path), retries=1) as pool,
        pytest.raises(PhysimError, match="Ray gave up a call"),
    ):
        list(pool.stream("crash", [(1,)]))


def test_loggers_tell_as_much_there(
    cluster: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """They write to the files of the cluster."""
    for level in (logging.DEBUG, logging.ERROR):
        caplog.set_level(level)
        with RayPool(partial(Workshop, tmp_path)) as pool:
            assert list(pool.stream("level", [()])) == [(0, level)]


def test_arguments_are_taken_as_they_are_needed(cluster: Any, tmp_path: Path) -> None:
    taken = 0

    def arguments() -> Iterator[tuple[int]]:
        nonlocal taken
        for n in range(50):
            taken += 1
            yield (n,)

    with RayPool(partial(Workshop, tmp_path)) as pool:
        results = pool.stream("square", arguments())
        next(results)
        assert taken < 10
        assert len(list(results)) == 49
