# SPDX-License-Identifier: MIT
"""Temporary folders that are removed even if their process is killed."""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from contextlib import suppress
from functools import partial
from pathlib import Path

from physim_drake.closing import Closing
from physim_drake.storage.locks import hold, remove_abandoned

_PREFIX = "physim-drake-"


class ScratchFolder(Closing):
    """A temporary folder, removed when it is closed or the process ends.

    A process that is killed removes nothing. So each folder is locked by its process,
    and whoever makes a new folder removes those that are no longer locked.

    Attributes:
        path: path of the folder.
    """

    def __init__(self) -> None:
        folders = Path(tempfile.gettempdir()).glob(f"{_PREFIX}*/")
        remove_abandoned(folders, partial(shutil.rmtree, ignore_errors=True))
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
            if hold(descriptor, without_locks=True) and path.is_dir():
                return path, descriptor
            os.close(descriptor)


def _remove(path: Path, descriptor: int) -> None:
    shutil.rmtree(path, ignore_errors=True)
    os.close(descriptor)
