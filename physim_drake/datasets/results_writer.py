# SPDX-License-Identifier: MIT
"""Writing results image by image, so that an interrupted run can go on.

Beside ``RESULTS.csv`` stands ``RESULTS.csv.progress``, JSON lines. The first holds the
settings of the run; each other one names an image and the length of the results file
with that image's rows. An image's rows reach the disk before its progress line does, so
what the last whole progress line says is true whenever the run is cut off. To resume,
the results file is cut to that length: that drops a torn line or half an image. An
image in which nothing was found has a progress line but no rows, and counts as done.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from io import FileIO
from pathlib import Path

import numpy as np

from physim_drake.closing import Closing
from physim_drake.datasets.bop import ImageId
from physim_drake.datasets.json_nodes import JsonNode
from physim_drake.datasets.results import COLUMNS, ResultRow, format_row
from physim_drake.errors import InputError
from physim_drake.files import cannot_write
from physim_drake.poses import is_rotation


class ResultsWriter(Closing):
    """Appends the results of one image after another; a context manager.

    Args:
        path: the results file. Without `resume` an existing one is replaced.
        resume: go on with what an earlier run wrote to `path`; where there is nothing
            yet, begin.
        settings: what must be the same in all parts of a run (names and values in
            plain text), for instance the seed and the detections.

    Attributes:
        path: as given.
        done: the images that are complete.

    Raises:
        InputError: where a file cannot be written, another run is writing it, or the
            earlier run cannot be resumed.
    """

    def __init__(
        self,
        path: Path,
        resume: bool = False,
        settings: Mapping[str, str] | None = None,
    ) -> None:
        self.path = path
        self.done: set[ImageId] = set()
        self._progress_path = path.with_name(path.name + ".progress")
        self._settings = dict(settings or {})
        if resume and path.exists() and not self._progress_path.exists():
            raise InputError(
                self._progress_path,
                "does not exist, so what is done in the results is not known",
                "run without --resume to begin again",
            )
        self._progress = _open_to_append(self._progress_path)
        try:
            _lock(self._progress, path)
            self._results = _open_to_append(path)
            try:
                self._begin(self._recover() if resume else 0)
            except BaseException:
                self._results.close()
                raise
        except BaseException:
            self._progress.close()
            raise

    def write_image(
        self,
        scene_id: int,
        im_id: int,
        rows: Sequence[ResultRow],
        time: float | None = None,
    ) -> None:
        """Adds all rows of one image, none where nothing was found.

        Args:
            scene_id: of the image.
            im_id: of the image.
            rows: its estimates; their `time` is replaced.
            time: seconds the whole image took.

        Raises:
            InputError: where the disk is full, or the file cannot be written or is
                there no more.
            ValueError: where the image is done, a row belongs to another image, or a
                pose is no pose.
        """
        image = (scene_id, im_id)
        if image in self.done:
            raise ValueError(f"image {image} is written already")
        for row in rows:
            if (row.scene_id, row.im_id) != image:
                raise ValueError(f"a row of image {image} says {row}")
            if not (np.isfinite(row.X_CO).all() and is_rotation(row.X_CO[:3, :3])):
                raise ValueError(f"object {row.object_id} of {image} has no pose")
        self._check_in_place()
        lines = [format_row(replace(row, time=time)) + "\n" for row in rows]
        length = self._append(self._results, self.path, "".join(lines))
        self._log({"scene_id": scene_id, "im_id": im_id, "length": length})
        self.done.add(image)

    def close(self) -> None:
        """Closes both files; the progress file stays, for a later --resume."""
        self._results.close()
        self._progress.close()

    def _check_in_place(self) -> None:
        """Raises `InputError` where what is written would reach no one."""
        for file, path in (
            (self._results, self.path),
            (self._progress, self._progress_path),
        ):
            try:
                there = os.path.samestat(os.stat(path), os.fstat(file.fileno()))
            except OSError:
                there = False
            if not there:
                raise InputError(
                    path, "was removed or replaced during the run", "run again"
                )

    def _begin(self, length: int) -> None:
        """Cuts the results to `length` bytes; 0 starts both files anew."""
        try:
            self._results.truncate(length)
            if length == 0:
                self.done.clear()
                self._progress.truncate(0)
        except OSError as error:
            raise cannot_write(self.path, error) from error
        if length == 0:
            header = ",".join(COLUMNS) + "\n"
            length = self._append(self._results, self.path, header)
            self._log({"settings": self._settings, "length": length})

    def _recover(self) -> int:
        """Reads the progress file; returns the length of the complete results."""
        self._progress.seek(0)
        # What follows the last line end was torn off; it is cut away as well.
        whole = self._progress.read().rpartition(b"\n")[0]
        length = 0
        for number, line in enumerate(whole.split(b"\n") if whole else []):
            node = self._parse(number + 1, line)
            length = node["length"].integer(minimum=length, maximum=1 << 60)
            if number == 0:
                self._compare_settings(node["settings"])
            else:
                self.done.add((node["scene_id"].integer(), node["im_id"].integer()))
        size = os.fstat(self._results.fileno()).st_size
        if length > size > 0:
            raise InputError(
                self.path,
                f"has {size} bytes, {self._progress_path.name} says {length}",
                "it was changed; run without --resume to begin again",
            )
        self._progress.truncate(len(whole) + 1 if whole else 0)
        return length if size > 0 else 0

    def _parse(self, number: int, line: bytes) -> JsonNode:
        try:
            return JsonNode(json.loads(line), self._progress_path, f"line {number}")
        except (ValueError, RecursionError):
            raise InputError(
                self._progress_path,
                "is not valid JSON",
                "run without --resume to begin again",
                f"line {number}",
            ) from None

    def _compare_settings(self, node: JsonNode) -> None:
        """Raises `InputError` where the earlier run had other settings."""
        earlier = node.value if isinstance(node.value, dict) else {}
        for name in sorted({*earlier, *self._settings}):
            was, now = earlier.get(name), self._settings.get(name)
            if was != now:
                raise InputError(
                    self._progress_path,
                    f"the run began with {was!r}, this one has {now!r}",
                    "use the same, or run without --resume to begin again",
                    str(name),
                )

    def _log(self, entry: Mapping[str, object]) -> None:
        self._append(self._progress, self._progress_path, json.dumps(entry) + "\n")

    def _append(self, file: FileIO, path: Path, text: str) -> int:
        """Appends `text`, waits until it is on the disk; returns the new length."""
        rest = memoryview(text.encode("utf-8"))
        before = file.seek(0, os.SEEK_END)
        try:
            while rest:
                rest = rest[file.write(rest) :]
            os.fsync(file.fileno())
            return file.seek(0, os.SEEK_END)
        except OSError as error:
            # Some lines of an image must not look like all of them.
            with suppress(OSError):
                file.truncate(before)
            raise cannot_write(path, error) from error


def _open_to_append(path: Path) -> FileIO:
    try:
        # Unbuffered, so that closing has nothing left to write that could fail.
        return path.open("ab+", buffering=0)
    except OSError as error:
        raise cannot_write(path, error) from error


def _lock(file: FileIO, results: Path) -> None:
    """Keeps a second run from writing to the same results."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InputError(
            results, "is being written by another run", "wait, or give another path"
        ) from None
    except OSError:
        # The file system has no locks; a run alone does not need one.
        return
