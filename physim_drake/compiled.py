# SPDX-License-Identifier: MIT
"""Functions compiled by numba, and kept for the next run if there is a place for them.

numba keeps them beside the sources, in `NUMBA_CACHE_DIR` or in the user's cache folder.
If it may not write to any of these, it refuses to work. If a disk is full, it fails
halfway. Here that costs no more than the time to compile again.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, cast

from numba import njit
from numba.core.caching import FunctionCache


class _OptionalCache(FunctionCache):  # type: ignore[misc]
    """A cache that ignores files that cannot be read or written."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        with suppress(OSError):
            return super().load_overload(sig, target_context)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):
            super().save_overload(sig, data)


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorates a function that numba compiles and that releases the GIL.

    Args:
        options: options of `numba.njit` other than `cache` and `nogil`.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = cast(Any, njit(nogil=True, **options)(function))
        with suppress(RuntimeError):  # numba finds nowhere to keep it
            dispatcher._cache = _OptionalCache(function)
        return dispatcher

    return decorate
