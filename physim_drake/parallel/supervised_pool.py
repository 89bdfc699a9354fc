# SPDX-License-Identifier: MIT
"""Processes that are looked after: replaced when they die, ended when they hang.

Each process makes one object of its own and then calls its methods, so that what is
costly to make is made once. A call must depend on nothing but its arguments and on what
`SupervisedPool.setup` gave the object; then a call whose process died can be made again
in another one, with the result it would have had.

Executors of the standard library, and those that replace dead processes (loky, pebble),
hold no such object that changes from image to image, which is why this is our own.
"""

from __future__ import annotations

import logging
import pickle
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from typing import Any

from physim_drake.closing import Closing
from physim_drake.errors import PhysimError
from physim_drake.parallel.log_levels import telling_as_here
from physim_drake.parallel.pool_process import PoolProcess, Reply

_LOOK = 1.0  # s between looks at how long calls take


@dataclass(frozen=True)
class SupervisionConfig:
    """What is done about processes that die or hang.

    Attributes:
        retries: number of times that a call is made again if its process died.
        time_limit: time after which a process that does not answer is ended, which
            counts as a death, s. Far longer than any call takes: the first run of all
            may compile for a minute, on a computer that has much else to do.
        start_limit: time that its first answer may take in addition, since starting it
            and making its object come before, s.
    """

    retries: int = 2
    time_limit: float = 300.0
    start_limit: float = 300.0

    def __post_init__(self) -> None:
        if self.retries < 0 or not (self.time_limit > 0 and self.start_limit >= 0):
            raise ValueError(f"must not be negative: {self}")


@dataclass
class _Call:
    """One call, and how the processes ended that died of it."""

    index: int
    method: str
    data: bytes
    deaths: list[str] = field(default_factory=list)


class SupervisedPool(Closing):
    """Some processes that call the methods of one object each.

    Args:
        make: function that gives the object. It is called in each process, so it must
            be picklable.
        processes: number of processes.
        config: limits, and what is done about processes that die.

    Use it as a context manager, or call `close`. If this process is killed, the
    others end at once. Their loggers tell as much as those of this process when the
    pool is made. Calls of the pool itself are for one thread at a time.
    """

    def __init__(
        self,
        make: Callable[[], object],
        processes: int,
        config: SupervisionConfig = SupervisionConfig(),
    ) -> None:
        self._make = pickle.dumps(telling_as_here(make))
        self._setup: bytes | None = None
        self._count, self._config = processes, config
        self._processes = [self._start() for _ in range(processes)]
        self._closed = False

    @property
    def pids(self) -> list[int]:
        """The processes at the moment."""
        return [p.pid for p in self._processes]

    def setup(self, method: str, *args: Any) -> None:
        """Calls a method in every process, and in those that replace one later.

        Raises:
            PhysimError: what the call raised, or that its processes died.
        """
        self._setup = pickle.dumps((method, args))
        # As many calls that do nothing as there are processes: one goes to each.
        self.map("", [()] * self._count)

    def map(self, method: str, arguments: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Calls a method once with each tuple of arguments.

        Returns:
            the results, in the order of the arguments.

        Raises:
            PhysimError: what a call raised, or that its processes died.
        """
        results = dict(self.stream(method, arguments))
        return [results[n] for n in range(len(arguments))]

    def stream(
        self, method: str, arguments: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Any]]:
        """As `map`, but gives (index, result) as soon as each is there.

        After a call that raised, those under way are waited for, no other begins, and
        the error of the first is raised.
        """
        if self._closed:
            raise RuntimeError("the pool is closed")
        todo = deque(
            _Call(n, method, pickle.dumps((method, args)))
            for n, args in enumerate(arguments)
        )
        errors: dict[int, Reply] = {}
        try:
            while True:
                if not errors:
                    self._hand_out(todo)
                busy = {p.link: p for p in self._processes if p.call is not None}
                if not busy:
                    break
                for process, call, reply in self._replies(busy):
                    if reply is None:
                        self._bury(process, call, todo)
                    elif reply[0] == "result":
                        yield call.index, reply[1]
                    else:
                        errors[call.index] = reply
        except BaseException:
            self._kill()  # replies are on their way that no one will fetch
            raise
        if errors:
            kind, value = errors[min(errors)]
            if kind == "error":
                raise value
            raise RuntimeError(f"in a worker:\n{value}")

    def _hand_out(self, todo: deque[_Call]) -> None:
        """Gives calls to idle processes; starts those that are missing."""
        alive = [p for p in self._processes if p.call is not None or p.is_alive()]
        missing = min(self._count - len(alive), len(todo))
        self._processes = alive + [self._start() for _ in range(missing)]
        for process in self._processes:
            if todo and process.call is None:
                call = todo.popleft()
                process.give(call, call.data, self._setup)

    def _replies(
        self, busy: Mapping[Connection, PoolProcess[_Call]]
    ) -> Iterator[tuple[PoolProcess[_Call], _Call, Reply | None]]:
        """Waits for replies, at most `_LOOK`; None for a process that is dead."""
        begun = time.monotonic()
        tick = min(_LOOK, self._config.time_limit / 4)
        ready: list[Any] = wait(list(busy), tick)
        # More than a tick has passed if this process was stopped or the computer slept;
        # the others had no time either.
        passed = min(time.monotonic() - begun, tick)
        for link, process in busy.items():
            call = process.call
            assert call is not None
            process.waited += passed
            if link in ready:
                yield process, call, process.receive()
            elif process.waited > process.limit:
                process.late = True
                yield process, call, None

    def _bury(
        self, process: PoolProcess[_Call], call: _Call, todo: deque[_Call]
    ) -> None:
        """Takes note of a death; the call is made again, unless that is too often."""
        self._processes.remove(process)
        call.deaths.append(process.autopsy())
        name, times = call.method or "setup", len(call.deaths)
        if times > self._config.retries:
            hint = "check whether memory runs out, and what they said above"
            if not call.method:  # a script without that starts them again in each
                hint += "; a script starts workers below `if __name__ == '__main__':`"
            raise PhysimError(
                f"{name} was given up after {times} worker processes ended in it: "
                f"{'; '.join(call.deaths)}; {hint}"
            )
        logging.getLogger(__name__).warning(
            "a worker process ended in %s: %s; that is done again",
            name,
            call.deaths[-1],
        )
        todo.appendleft(call)

    def _start(self) -> PoolProcess[_Call]:
        config = self._config
        return PoolProcess(self._make, config.time_limit, config.start_limit)

    def _kill(self) -> None:
        for process in self._processes:
            process.kill()
        for process in self._processes:
            process.join()
        self._processes = []

    def close(self) -> None:
        """Ends the processes at once; they have nothing to finish."""
        self._closed = True
        self._kill()
