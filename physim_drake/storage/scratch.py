# SPDX-License-Identifier: MIT
"""Temporary folders that are removed even if their process is killed."""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
import weakref
from contextlib import suppress
from pathlib import Path

from physim_drake.closing import Closing

_PREFIX = "physim-drake-"


class ScratchFolder(Closing):
    """A temporary folder, removed when it is closed or the process ends.

    A process that is killed removes nothing. So each folder is locked by its process,
    and whoever makes a new folder removes those that are no longer locked.

    Attributes:
        path: path of the folder.
    """

    def __init__(self) -> None:
        _remove_abandoned(Path(tempfile.gettempdir()))
        self.path, descriptor = _make()
        self._end = weakref.finalize(self, _remove, self.path, descriptor)

    def close(self) -> None:
        """Removes the folder with all that is in it."""
        self._end()


def _make() -> tuple[Path, int]:
    """A new folder, and its open file descriptor, which holds the lock."""
    while True:
        path = Path(tempfile.mkdtemp(prefix=_PREFIX))
        with suppress(OSError):  # before it is locked it may be taken for abandoned
            descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
            if _hold(descriptor, without_locks=True) and path.is_dir():
                return path, descriptor
            os.close(descriptor)


def _hold(descriptor: int, *, without_locks: bool) -> bool:
    """Locks a folder; False if another process holds the lock.

    Args:
        descriptor: open file descriptor of the folder.
        without_locks: value to return if the file system has no locks.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return without_locks
    return True


def _remove_abandoned(parent: Path) -> None:
    """Removes the folders whose processes have ended."""
    for path in parent.glob(f"{_PREFIX}*"):
        with suppress(OSError):  # it was removed meanwhile, or is another user's
            flags = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW
            descriptor = os.open(path, flags)
            if _hold(descriptor, without_locks=False):
                shutil.rmtree(path, ignore_errors=True)
            os.close(descriptor)


def _remove(path: Path, descriptor: int) -> None:
    shutil.rmtree(path, ignore_errors=True)
    os.close(descriptor)
