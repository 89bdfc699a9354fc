# SPDX-License-Identifier: MIT
"""Functions compiled by numba, and kept for the next run where there is a place.

numba keeps them beside the sources, in `NUMBA_CACHE_DIR` or in the user's cache folder.
Where none of these may be written it refuses to work, and where a disk is full it fails
in the midst of it. Here that costs no more than the time to compile again.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, cast

from numba import njit
from numba.core.caching import FunctionCache


class _OptionalCache(FunctionCache):  # type: ignore[misc]
    """Does without the files that cannot be read or written."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        with suppress(OSError):
            return super().load_overload(sig, target_context)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):
            super().save_overload(sig, data)


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorates a function to be compiled; other threads run meanwhile.

    Args:
        options: of `numba.njit`, beyond `cache` and `nogil`.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = cast(Any, njit(nogil=True, **options)(function))
        with suppress(RuntimeError):  # there is no place to keep it
            dispatcher._cache = _OptionalCache(function)
        return dispatcher

    return decorate
