# SPDX-License-Identifier: MIT
"""Locks on files and folders that end with the process that holds them.

Whatever a process has locked is in use. If it was killed, another process can lock what
it left behind. This is how abandoned temporary files are recognised.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path


def hold(descriptor: int, *, without_locks: bool) -> bool:
    """Locks a file or folder for as long as it is open.

    Args:
        descriptor: descriptor of the file or folder.
        without_locks: answer on a file system that has no locks.

    Returns:
        False if another process holds it.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return without_locks
    return True


def remove_abandoned(paths: Iterable[Path], remove: Callable[[Path], object]) -> None:
    """Removes files or folders that no process holds any more.

    Args:
        paths: files or folders, each made by a process that held it since.
        remove: function that removes one; it may raise `OSError`.
    """
    for path in paths:
        with suppress(OSError):  # it is gone by now, or belongs to another user
            # Without waiting: somebody else's pipe may have such a name.
            flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK
            descriptor = os.open(path, flags)
            try:
                if hold(descriptor, without_locks=False):
                    remove(path)
            finally:
                os.close(descriptor)
