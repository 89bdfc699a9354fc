# SPDX-License-Identifier: MIT
"""Runs programs of this package in their own sessions, to inspect and to end them.

The processes of a session are read from ``/proc``, so this works on Linux only.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

PROGRAM = (
    sys.executable,
    "-c",
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "from physim_drake.cli import main; main()",
)
"""Begins each command line. Ctrl-C works even if a shell would have it ignored."""
_ORPHAN = 1.0  # s
_SHARED = Path("/dev/shm")
_SEGMENTS = ("psm_*", "sem.mp-*", "torch_*")  # as Python and torch name theirs


@contextmanager
def started(
    command: Sequence[str], scratch: Path
) -> Iterator[tuple[subprocess.Popen[bytes], IO[str]]]:
    """Starts a program in its own session, and kills it if the block is broken off.

    What it prints goes to a file. A pipe would stay open as long as anything that it
    left behind runs, so that reading it to the end would wait for that.

    Args:
        command: program and its arguments.
        scratch: folder for its temporary files. It is made.

    Yields:
        the program, and what it has printed.
    """
    scratch.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile("w+", errors="replace") as output:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env={**os.environ, "TMPDIR": str(scratch), "OMP_NUM_THREADS": "1"},
        )
        try:
            yield process, output
        except BaseException:  # Ctrl-C does not reach another session
            process.kill()
            process.wait()
            end(session(process.pid))
            raise


def run(command: Sequence[str], folder: Path) -> None:
    """Runs a program to its end.

    Raises:
        RuntimeError: if the program fails.
    """
    with started(command, folder / "tmp") as (process, output):
        if process.wait() != 0:
            said = printed(output)
            raise RuntimeError(f"{' '.join(command[3:])}:\n{said}")


def printed(output: IO[str]) -> str:
    """The output of a program that has ended."""
    output.seek(0)
    return output.read()


def end(pids: Iterable[int]) -> None:
    """Kills processes."""
    for pid in pids:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def session(pid: int) -> list[int]:
    """The living processes of a session but its leader."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, leader = path.read_text().rpartition(")")[2].split()[:4]
        except OSError:
            continue  # it has ended meanwhile
        number = int(path.parent.name)
        if int(leader) == pid != number and state != "Z":
            found.append(number)
    return found


def command(pid: int) -> str:
    """The command line of a process, empty if it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return ""


def segments() -> set[Path]:
    """The shared memory that Python or torch made, whoever uses it."""
    return {path for name in _SEGMENTS for path in _SHARED.glob(name)}


def outlived(pid: int) -> list[int]:
    """What still runs of a session some time after its leader ended."""
    deadline = time.monotonic() + _ORPHAN
    while (left := session(pid)) and time.monotonic() < deadline:
        time.sleep(0.02)
    return left
