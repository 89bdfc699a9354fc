# SPDX-License-Identifier: MIT
"""One process of a `SupervisedPool`: what it does, and how the pool sees it.

Light to import, since every such process begins with it.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import pickle
import signal
import socket
import struct
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, TypeVar

from physim_drake.errors import PhysimError

MAKE, SETUP, CALL = "make", "setup", "call"
"""What a message asks for; a call alone is replied to."""

Reply = tuple[str, Any]
"""("result", value), ("error", a `PhysimError`) or ("crash", a traceback)."""

Call = TypeVar("Call")

_PR_SET_PDEATHSIG = 1  # Linux's sys/prctl.h


class PoolProcess(Generic[Call]):
    """One process of a pool, seen from the pool.

    Args:
        make: function that gives its object, pickled.
        time_limit: time that it may take to answer a call, s.
        start_limit: time that it may take in addition to answer the first one, s.

    Attributes:
        link: connection to it.
        call: the call that it works on, if any.
        waited: time that its answer has taken so far, s.
        limit: time that its answer may take, s.
        late: whether it was ended because it took too long.
    """

    def __init__(self, make: bytes, time_limit: float, start_limit: float) -> None:
        context = multiprocessing.get_context("spawn")
        self.link, theirs = context.Pipe()
        self._time_limit = time_limit
        self._set_limit(time_limit + start_limit)
        # If the thread that makes the pool may end before it, the kernel must not take
        # that for the end of this process.
        lasting = threading.current_thread() is threading.main_thread()
        self._process = context.Process(
            target=serve, args=(theirs, lasting), daemon=True
        )
        with _interrupts_held():
            self._process.start()
        theirs.close()
        self.call: Call | None = None
        self.waited, self.late = 0.0, False
        self._setup: bytes | None = None
        self._send(MAKE, make)

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid or 0

    def is_alive(self) -> bool:
        """Whether the process runs."""
        return self._process.is_alive()

    def give(self, call: Call, data: bytes, setup: bytes | None) -> None:
        """Sends a call, and before it the setup unless it has been.

        Args:
            call: what the caller knows it by.
            data: method and arguments, pickled.
            setup: method and arguments of the setup, pickled.
        """
        self.call, self.waited = call, 0.0
        if setup is not None and setup is not self._setup:
            self._send(SETUP, setup)
            self._setup = setup
        self._send(CALL, data)

    def receive(self) -> Reply | None:
        """The reply to the call; None if the process is dead."""
        try:
            reply: Reply = self.link.recv()
        except (EOFError, OSError):
            return None
        self.call = None
        if self.limit != self._time_limit:
            self._set_limit(self._time_limit)
        return reply

    def kill(self) -> None:
        """Ends it at once."""
        self.link.close()
        self._process.kill()

    def join(self) -> None:
        """Waits for its end."""
        self._process.join()

    def autopsy(self) -> str:
        """How a process ended that no longer answers; makes sure that it has ended."""
        if not self.late:
            self._process.join(1.0)  # its link breaks a little before its end
        self.kill()
        self.join()
        code = self._process.exitcode or 0
        if self.late:
            return f"no answer for {self.limit:g} s"
        if code < 0:
            return f"signal {-code} ({signal.strsignal(-code)})"
        return f"exit status {code}"

    def _set_limit(self, seconds: float) -> None:
        self.limit = seconds
        _limit_waiting(self.link, seconds)

    def _send(self, kind: str, data: bytes) -> None:
        # If it is dead or does not read, its reply will be missing.
        try:
            self.link.send((kind, data))
        except OSError:
            self._process.kill()


def serve(link: Connection, parent_thread_lasts: bool) -> None:
    """Makes an object and calls its methods, as messages on `link` say.

    Args:
        link: connection to the pool.
        parent_thread_lasts: whether the thread that started this process lives as long
            as its own process.
    """
    os.environ["OMP_NUM_THREADS"] = "1"
    _end_with_parent(parent_thread_lasts)
    target: Any = None
    failed: dict[str, Reply] = {}
    while True:
        try:
            kind, data = link.recv()
        except (EOFError, OSError):
            return  # the pool is closed
        failed.pop(kind, None)
        reply = next(iter(failed.values()), None) or _attempt(kind, data, target)
        if kind == CALL:
            try:
                link.send_bytes(_pickled(reply))
            except OSError:
                return
        elif reply[0] != "result":
            failed[kind] = reply  # what is said to the calls that follow
        elif kind == MAKE:
            target = reply[1]


def _attempt(kind: str, data: bytes, target: Any) -> Reply:
    try:
        if kind == MAKE:
            return "result", pickle.loads(data)()
        method, args = pickle.loads(data)
        return "result", getattr(target, method)(*args) if method else None
    except (PhysimError, OSError) as error:
        return "error", error
    except Exception:
        return "crash", traceback.format_exc()


def _pickled(reply: Reply) -> bytes:
    try:
        return pickle.dumps(reply)
    except Exception:
        return pickle.dumps(("crash", traceback.format_exc()))


def _end_with_parent(parent_thread_lasts: bool) -> None:
    """Has this process end with the one that started it, however that ends.

    Linux ends it even in the midst of a computation, but takes the end of the parent's
    thread for that of the parent. A thread that waits works everywhere, as soon as the
    computation lets it run.
    """
    if parent_thread_lasts and sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    threading.Thread(target=_wait_for_parent, daemon=True).start()


def _wait_for_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def _limit_waiting(link: Connection, seconds: float) -> None:
    """Lets reads and writes of half a message fail if the other side has stopped."""
    limit = struct.pack("ll", int(seconds), int(seconds % 1 * 1e6))
    with suppress(OSError), socket.socket(fileno=socket.dup(link.fileno())) as end:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, limit)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Blocks Ctrl-C, for processes that start here for good.

    It reaches every process of a terminal; this one alone acts on it.
    """
    # Python's tracker of shared resources would be started with the first process, and
    # lift the block again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
