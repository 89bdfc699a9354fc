# SPDX-License-Identifier: MIT
from __future__ import annotations

import os
import sys
import time
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path

import pytest

from benchmarks.processes import (
    end,
    outlived,
    printed,
    run,
    segments,
    session,
    started,
)

LEAVES_ONE = (
    "import subprocess, sys; print('on its way', flush=True);"
    "subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])"
)


def test_what_outlives_a_program_is_seen(tmp_path: Path) -> None:
    with started([sys.executable, "-c", LEAVES_ONE], tmp_path / "new") as (one, output):
        assert one.wait(60) == 0
        left = outlived(one.pid)
        assert len(left) == 1
        end(left)
        assert printed(output) == "on its way\n"
        assert outlived(one.pid) == []


def test_nothing_runs_on_where_the_block_is_broken_off(tmp_path: Path) -> None:
    seen = []

    def break_off() -> None:
        wait = [sys.executable, "-c", f"{LEAVES_ONE}.wait()"]
        with started(wait, tmp_path) as (one, _):
            seen.append(one)
            while not session(one.pid):
                time.sleep(0.01)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        break_off()
    (one,) = seen
    assert one.returncode == -9
    assert outlived(one.pid) == []


def test_a_failure_is_told_with_what_was_printed(tmp_path: Path) -> None:
    run([sys.executable, "-c", "pass"], tmp_path)
    fails = [sys.executable, "-c", "import os; print(os.environ['TMPDIR']); exit(3)"]
    with pytest.raises(RuntimeError, match=str(tmp_path / "tmp")):
        run(fails, tmp_path)


@pytest.mark.skipif(not Path("/dev/shm").is_dir(), reason="needs Linux")
def test_shared_memory_is_seen() -> None:
    memory = SharedMemory(create=True, size=1)
    path = Path("/dev/shm", memory.name)
    assert path in segments()
    memory.close()
    memory.unlink()
    assert path not in segments()


def test_processes_that_are_gone_are_no_error() -> None:
    gone = os.fork()
    if gone == 0:
        os._exit(0)
    os.waitpid(gone, 0)
    end([gone])
    assert outlived(gone) == []
