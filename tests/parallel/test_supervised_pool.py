# SPDX-License-Identifier: MIT
"""Pools of processes of a small counter, which can die and hang when told to."""

from __future__ import annotations

import ctypes
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from physim_drake.errors import InputError, PhysimError
from physim_drake.parallel.supervised_pool import SupervisedPool, SupervisionConfig

QUICK = SupervisionConfig(retries=2, time_limit=30.0)


class Adder:
    """Adds a number to others."""

    def __init__(self) -> None:
        self.number = 0

    def set_number(self, number: int) -> None:
        if number < 0:
            raise InputError("number", "is negative", "give another")
        self.number = number

    def add(self, number: int) -> int:
        return self.number + number

    def add_once_alive(self, number: int, folder: Path, signal_number: int) -> int:
        """As `add`, but the first process to be asked gets a signal."""
        try:
            (folder / str(number)).mkdir()
        except FileExistsError:
            return self.add(number)
        os.kill(os.getpid(), signal_number)
        return self.add(number)

    def die(self, log: Path) -> None:
        with log.open("a") as file:
            file.write(f"{os.getpid()}\n")
        os.abort()

    def pid(self) -> int:
        time.sleep(0.05)  # so that each process gets one
        return os.getpid()

    def length(self, data: bytes) -> int:
        return len(data)

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)

    def sleep_holding_the_lock(self, seconds: int) -> None:
        """As a computation in C that lets no other thread of the interpreter run."""
        ctypes.PyDLL(None).sleep(seconds)

    def fail(self) -> None:
        raise ValueError("a defect")

    def read(self, path: Path) -> str:
        return path.read_text()

    def unsendable(self) -> Callable[[], None]:
        return lambda: None


def unmakeable() -> Adder:
    raise InputError("library", "is empty", "fill it")


@pytest.fixture
def pool() -> Iterator[SupervisedPool]:
    with SupervisedPool(Adder, 2, QUICK) as made:
        yield made


def test_results_come_in_order(pool: SupervisedPool) -> None:
    assert pool.map("add", [(n,) for n in range(20)]) == list(range(20))
    assert pool.map("add", []) == []
    assert sorted(pool.stream("add", [(5,), (6,)])) == [(0, 5), (1, 6)]


def test_setup_reaches_every_process(pool: SupervisedPool) -> None:
    pool.setup("set_number", 100)
    assert len(set(pool.map("pid", [()] * 2))) == 2
    assert pool.map("add", [(n,) for n in range(8)]) == [100 + n for n in range(8)]


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSEGV, signal.SIGTERM])
def test_a_dead_process_is_replaced_and_its_call_made_again(
    pool: SupervisedPool, tmp_path: Path, how: int, caplog: pytest.LogCaptureFixture
) -> None:
    pool.setup("set_number", 10)
    calls = [(n, tmp_path, how if n == 3 else 0) for n in range(6)]
    before = set(pool.pids)
    assert pool.map("add_once_alive", calls) == [10 + n for n in range(6)]
    assert len(before & set(pool.pids)) == 1
    assert f"signal {int(how)}" in caplog.text


def test_processes_that_die_idle_are_replaced(pool: SupervisedPool) -> None:
    pool.setup("set_number", 7)
    for pid in pool.pids:
        os.kill(pid, signal.SIGKILL)
    assert pool.map("add", [(n,) for n in range(5)]) == [7 + n for n in range(5)]


def test_a_process_that_is_killed_while_it_starts_is_replaced() -> None:
    for wait in (0.0, 0.02, 0.1):
        with SupervisedPool(Adder, 2, QUICK) as pool:
            time.sleep(wait)
            os.kill(pool.pids[0], signal.SIGKILL)
            pool.setup("set_number", 1)
            assert pool.map("add", [(1,), (2,)]) == [2, 3]


def test_a_call_that_always_kills_is_given_up(
    pool: SupervisedPool, tmp_path: Path
) -> None:
    log = tmp_path / "pids"
    with pytest.raises(
        PhysimError, match=r"die was given up after 3 .*signal 6"
    ) as caught:
        pool.map("die", [(log,)])
    assert len(set(log.read_text().split())) == 3
    assert "\n" not in str(caught.value)
    assert pool.map("add", [(1,)]) == [1]  # the pool goes on


def test_a_file_that_fails_is_named_here(pool: SupervisedPool, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as caught:
        pool.map("read", [(tmp_path / "none",)])
    assert caught.value.filename == str(tmp_path / "none")


@pytest.mark.parametrize("how", [signal.SIGSTOP, None])
def test_a_process_that_hangs_is_ended(tmp_path: Path, how: int | None) -> None:
    config = SupervisionConfig(retries=0, time_limit=2.0, start_limit=120.0)
    with SupervisedPool(Adder, 2, config) as pool:
        pool.setup("set_number", 1)
        hung = set(pool.pids)
        call = ("sleep", [(600.0,)])
        if how is not None:
            call = ("add_once_alive", [(5, tmp_path, how)])
        start = time.monotonic()
        with pytest.raises(PhysimError, match=r"after 1 .*no answer for 2 s"):
            pool.map(*call)
        assert 1.9 < time.monotonic() - start < 10
        assert not any(alive(pid) for pid in hung)


def test_a_message_to_a_process_that_has_stopped_does_not_hang() -> None:
    config = SupervisionConfig(retries=1, time_limit=2.0, start_limit=120.0)
    with SupervisedPool(Adder, 1, config) as pool:
        pool.setup("set_number", 1)
        stopped = pool.pids[0]
        os.kill(stopped, signal.SIGSTOP)
        long = bytes(10_000_000)  # more than a pipe holds
        assert pool.map("length", [(long,)]) == [len(long)]
        deadline = time.monotonic() + 5
        while alive(stopped) and time.monotonic() < deadline:
            time.sleep(0.01)
        assert not alive(stopped)


def test_errors_arrive_and_the_pool_goes_on(pool: SupervisedPool) -> None:
    with pytest.raises(InputError, match="is negative"):
        pool.setup("set_number", -1)
    with pytest.raises(InputError, match="is negative"):
        pool.map("add", [(1,)])
    pids = set(pool.pids)
    pool.setup("set_number", 2)
    assert pool.map("add", [(1,)]) == [3]
    with pytest.raises(RuntimeError, match="ValueError: a defect"):
        pool.map("fail", [(), ()])
    with pytest.raises(RuntimeError, match="pickle"):
        pool.map("unsendable", [()])
    assert pool.map("add", [(1,)]) == [3]
    assert set(pool.pids) == pids


def test_an_object_that_cannot_be_made_is_said() -> None:
    with (
        SupervisedPool(unmakeable, 2, QUICK) as pool,
        pytest.raises(InputError, match="library: is empty"),
    ):
        pool.setup("set_number", 1)


def test_a_stream_that_is_left_leaves_no_replies(pool: SupervisedPool) -> None:
    stream = pool.stream("add", [(n,) for n in range(10)])
    next(stream)
    stream.close()
    assert pool.map("add", [(50,)]) == [50]


def test_closing_ends_the_processes_at_once(pool: SupervisedPool) -> None:
    pids = pool.pids
    start = time.monotonic()
    pool.close()
    assert not any(alive(pid) for pid in pids)
    assert time.monotonic() - start < 1
    with pytest.raises(RuntimeError, match="closed"):
        pool.map("add", [(1,)])


def test_a_pool_made_by_a_thread_outlives_it() -> None:
    made: list[SupervisedPool] = []
    thread = threading.Thread(
        target=lambda: made.append(SupervisedPool(Adder, 1, QUICK))
    )
    thread.start()
    thread.join()
    with made[0] as pool:
        pids = pool.pids
        assert pool.map("add", [(1,)]) == [1]
        assert pool.pids == pids


SLEEPERS = """
from physim_drake.parallel.supervised_pool import SupervisedPool
from tests.parallel.test_supervised_pool import Adder

with SupervisedPool(Adder, 2) as pool:
    pool.setup("set_number", 1)
    print(*pool.pids, flush=True)
    pool.map("{}", [(600,)] * 2)
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
@pytest.mark.parametrize("method", ["sleep", "sleep_holding_the_lock"])
def test_no_process_outlives_its_parent(how: int, method: str) -> None:
    code = SLEEPERS.format(method)
    parent = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True
    )
    assert parent.stdout is not None
    pids = [int(word) for word in parent.stdout.readline().split()]
    assert len(pids) == 2
    time.sleep(0.3)
    parent.send_signal(how)
    parent.wait()
    deadline = time.monotonic() + 2
    while any(alive(pid) for pid in pids) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not any(alive(pid) for pid in pids)
    parent.stdout.close()


def test_the_terminal_s_ctrl_c_does_not_reach_the_processes() -> None:
    parent = subprocess.Popen(
        [sys.executable, "-c", SLEEPERS.format("sleep")],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert parent.stdout is not None
    pids = [int(word) for word in parent.stdout.readline().split()]
    statuses = [Path(f"/proc/{pid}/status").read_text() for pid in pids]
    parent.kill()
    parent.wait()
    parent.stdout.close()
    assert len(statuses) == 2
    for status in statuses:
        (blocked,) = re.findall(r"^SigBlk:\s*(\w+)$", status, re.MULTILINE)
        assert int(blocked, 16) & 1 << signal.SIGINT - 1


def alive(pid: int) -> bool:
    """Whether a process runs. One that has ended and is not fetched does not."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except FileNotFoundError:
        return False
    return stat.rpartition(")")[2].split()[0] != "Z"
