# SPDX-License-Identifier: MIT
"""Calls on the machines of a Ray cluster: those of `SupervisedPool`, further away.

Calls are tasks, not actors: if a machine is lost, its tasks begin anew on those that
are left, and machines that join take part. Each worker process makes the object that
is called once and keeps it. https://docs.ray.io/en/latest/ray-core/fault-tolerance.html
"""

from __future__ import annotations

import logging
import os
import pickle
import socket
import uuid
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar

from physim_drake.closing import Closing
from physim_drake.errors import InputError, PhysimError
from physim_drake.extras import need_extra
from physim_drake.parallel.log_levels import telling_as_here

_Result = TypeVar("_Result")

_PATIENCE = 10.0  # s until a cluster must answer
_AHEAD = 2  # calls a processor that are on their way
_made: tuple[str, Any] = ("", None)  # in a worker process: the object, and which it is


class RayPool(Closing):
    """Calls the methods of one object, made anew in every worker process.

    The machines are those of the cluster that the variable RAY_ADDRESS names, or that
    ``ray start`` began on this machine. They need the same version of this package, but
    no common files.

    Args:
        make: function that gives the object; must be picklable.
        retries: number of times that a call is made again if its process or machine
            died.

    Raises:
        InputError: if Ray is not installed or its cluster cannot be reached.

    Use it as a context manager, or call `close`.
    """

    def __init__(self, make: Callable[[], object], retries: int = 3) -> None:
        self._ray = _connect()
        self._key = uuid.uuid4().hex
        self._make = self._ray.put(pickle.dumps(telling_as_here(make)))
        self._call = self._ray.remote(
            num_cpus=1, max_retries=retries, retry_exceptions=False
        )(call_method)

    def stream(
        self, method: str, arguments: Iterable[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Any]]:
        """Calls a method once with each tuple of arguments.

        Arguments are taken as processors become free, so that few are in memory.

        Yields:
            the index of a call and its result, as soon as it is there.

        Raises:
            PhysimError: what a call raised, or that the processes in which it was tried
                died; or, after the calls before it, what taking an argument raised.
        """
        ray, todo = self._ray, enumerate(arguments)
        under_way: dict[Any, int] = {}
        stop: PhysimError | None = None
        try:
            while True:
                while stop is None and len(under_way) < self._room():
                    try:
                        index, args = next(todo)
                    except StopIteration:
                        break
                    except PhysimError as error:  # after the calls before it
                        stop = error
                        break
                    data = pickle.dumps((method, args))
                    under_way[self._call.remote(self._key, self._make, data)] = index
                if not under_way:
                    break
                done, _ = ray.wait(list(under_way))
                for reference in done:
                    yield under_way.pop(reference), self._result(reference)
        finally:
            for reference in under_way:
                ray.cancel(reference, force=True)
        if stop is not None:
            raise stop

    def close(self) -> None:
        """Forgets the object; the connection to the cluster stays."""
        self._make = None

    def _room(self) -> int:
        """How many calls may be on their way; machines come and go."""
        return max(_AHEAD * int(self._ray.cluster_resources().get("CPU", 1)), 1)

    def _result(self, reference: Any) -> Any:
        try:
            kind, value = pickle.loads(self._ray.get(reference))
        except self._ray.exceptions.RayError as error:
            raise PhysimError(
                f"Ray gave up a call: {str(error).splitlines()[0]}; check whether "
                "machines were lost or memory ran out"
            ) from None
        if kind == "error":
            raise value
        return value


def call_method(key: str, make: bytes, data: bytes) -> bytes:
    """Runs in a worker process: makes the object unless it is there, and calls it.

    Args:
        key: name of the object.
        make: function that gives it, pickled.
        data: method and arguments, pickled.

    Returns:
        ("result", value) or ("error", a `PhysimError`), pickled.
    """
    global _made
    try:
        if _made[0] != key:
            _made = (key, pickle.loads(make)())
        method, args = pickle.loads(data)
        return pickle.dumps(("result", getattr(_made[1], method)(*args)))
    except PhysimError as error:
        return pickle.dumps(("error", error))


def in_order(results: Iterable[tuple[int, _Result]]) -> Iterator[_Result]:
    """The results by index, each as soon as those before it are there.

    Args:
        results: pairs of index, from 0, and result, in any order.
    """
    waiting: dict[int, _Result] = {}
    following = 0
    for index, result in results:
        waiting[index] = result
        while following in waiting:
            yield waiting.pop(following)
            following += 1


def _connect() -> Any:
    """The module ray, connected to a cluster."""
    need_extra("ray")
    import ray

    if not ray.is_initialized():
        try:
            address = os.environ.get("RAY_ADDRESS", "")
            _knock(address)
            # Without "auto" it would begin a cluster, open to the whole network.
            ray.init(
                address or "auto", log_to_driver=False, logging_level=logging.ERROR
            )
        except (ConnectionError, OSError, RuntimeError, ValueError) as error:
            raise InputError(
                "RAY_ADDRESS",
                f"no Ray cluster answers: {str(error).splitlines()[0]}",
                "name one that runs, or start one with `ray start --head`; to use this "
                "machine alone, leave --engine out",
            ) from None
    return ray


def _knock(address: str) -> None:
    """Finds out in seconds whether anyone listens at HOST:PORT; Ray tries for long.

    Raises:
        OSError: if no one does.
    """
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host and port.isdigit():
        socket.create_connection((host, int(port)), timeout=_PATIENCE).close()
