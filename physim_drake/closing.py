# SPDX-License-Identifier: MIT
"""What holds processes, files or folders, and gives them up at the end of a `with`."""

from __future__ import annotations

from types import TracebackType
from typing import Self


class Closing:
    """A context manager that is closed at the end.

    Not an abstract base class: Drake's systems, which have a metaclass of their own,
    can be such things, too.
    """

    def close(self) -> None:
        """Gives up what it holds; may be called twice."""
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
