# SPDX-License-Identifier: MIT
"""Notes about the progress of a long run, so that it can be resumed.

A progress file is JSON lines. The first holds the settings of the run, each other one a
note about a piece of its work. A note reaches the disk before the next piece begins, so
all whole lines are true whenever the run is interrupted. To resume, a partial last line
is removed.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from io import FileIO
from pathlib import Path

from physim_drake.closing import Closing
from physim_drake.errors import InputError
from physim_drake.storage.files import cannot_write
from physim_drake.storage.json_nodes import JsonNode
from physim_drake.storage.locks import hold

_AGAIN = "run without --resume to begin again"


class ProgressFile(Closing):
    """The progress file of a run, locked against other runs.

    Args:
        path: progress file; it is made if it does not exist.
        settings: settings that all parts of a run must share (names and values in
            plain text), for instance the seed.
        results: file or folder that the run writes, for messages.

    Attributes:
        path: progress file.

    Raises:
        InputError: if the file cannot be written, or another run is writing it.
    """

    def __init__(self, path: Path, settings: Mapping[str, str], results: Path) -> None:
        self.path = path
        self._settings = dict(settings)
        self._file = open_to_append(path)
        # Without locks, a run that is alone does not need one.
        if not hold(self._file.fileno(), without_locks=True):
            self._file.close()
            raise InputError(
                results, "is being written by another run", "wait, or give another path"
            )

    def go_on(self, resume: bool) -> list[JsonNode]:
        """Begins, or resumes an earlier run.

        Args:
            resume: True to resume an earlier run, False to drop its notes.

        Returns:
            the earlier run's notes.

        Raises:
            InputError: as `recover` and `begin`.
        """
        notes = self.recover() if resume else None
        if notes is None:
            self.begin()
        return notes or []

    def recover(self) -> list[JsonNode] | None:
        """Reads an earlier run's notes; None if it did not note its settings.

        Raises:
            InputError: if it had other settings, or the file is damaged.
        """
        self._file.seek(0)
        # What follows the last line end is a partial line, which is removed.
        whole = self._file.read().rpartition(b"\n")[0]
        lines = whole.split(b"\n") if whole else []
        notes = [self._parse(number, line) for number, line in enumerate(lines, 1)]
        if notes:
            self._compare_settings(notes[0]["settings"])
        self._file.truncate(len(whole) + 1 if whole else 0)
        return notes[1:] if notes else None

    def clear(self) -> None:
        """Removes everything.

        Raises:
            InputError: if the file cannot be written.
        """
        try:
            self._file.truncate(0)
        except OSError as error:
            raise cannot_write(self.path, error) from error

    def begin(self) -> None:
        """Removes everything and writes the settings.

        Raises:
            InputError: as `add`.
        """
        self.clear()
        self.add({"settings": self._settings})

    def add(self, note: Mapping[str, object]) -> None:
        """Writes a note; it is on the disk when this returns.

        Raises:
            InputError: if the disk is full, or the file cannot be written.
        """
        append(self._file, self.path, json.dumps(note) + "\n")

    def check_in_place(self) -> None:
        """Raises `InputError` if the file was removed or replaced."""
        check_in_place(self._file, self.path)

    def close(self) -> None:
        """Closes the file, which stays for a later --resume."""
        self._file.close()

    def _parse(self, number: int, line: bytes) -> JsonNode:
        try:
            return JsonNode(json.loads(line), self.path, f"line {number}")
        except (ValueError, RecursionError):
            raise InputError(
                self.path, "is not valid JSON", _AGAIN, f"line {number}"
            ) from None

    def _compare_settings(self, node: JsonNode) -> None:
        """Raises `InputError` if the earlier run had other settings."""
        earlier = node.value if isinstance(node.value, dict) else {}
        for name in sorted({*earlier, *self._settings}):
            was, now = earlier.get(name), self._settings.get(name)
            if was != now:
                raise InputError(
                    self.path,
                    f"the run began with {was!r}, this one has {now!r}",
                    f"use the same, or {_AGAIN}",
                    str(name),
                )


def open_to_append(path: Path) -> FileIO:
    """Opens a file to append to; makes it if it does not exist.

    Raises:
        InputError: if it cannot be written.
    """
    try:
        # Unbuffered, so that closing has nothing left to write that could fail.
        return path.open("ab+", buffering=0)
    except OSError as error:
        raise cannot_write(path, error) from error


def append(file: FileIO, path: Path, text: str) -> int:
    """Appends a text and waits until it is on the disk.

    Args:
        file: file from `open_to_append`.
        path: path of the file, for messages.
        text: text to append; if it cannot be written whole, nothing is written.

    Returns:
        new length of the file, bytes.

    Raises:
        InputError: if the disk is full, or the file cannot be written.
    """
    rest = memoryview(text.encode("utf-8"))
    before = file.seek(0, os.SEEK_END)
    try:
        while rest:
            rest = rest[file.write(rest) :]
        os.fsync(file.fileno())
        return file.seek(0, os.SEEK_END)
    except OSError as error:
        # A part of the text must not be taken for the whole.
        with suppress(OSError):
            file.truncate(before)
        raise cannot_write(path, error) from error


def check_in_place(file: FileIO, path: Path) -> None:
    """Raises `InputError` if an open file is no longer the one at its path."""
    try:
        there = os.path.samestat(os.stat(path), os.fstat(file.fileno()))
    except OSError:
        there = False
    if not there:
        raise InputError(path, "was removed or replaced during the run", "run again")
