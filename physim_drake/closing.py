# SPDX-License-Identifier: MIT
"""Objects that hold processes, files or folders, released at the end of a `with`."""

from __future__ import annotations

from types import TracebackType
from typing import Self


class Closing:
    """A context manager that calls `close` at the end.

    It is not an abstract base class, so that Drake's systems, which have a metaclass of
    their own, can inherit from it.
    """

    def close(self) -> None:
        """Releases what it holds. It may be called twice."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
