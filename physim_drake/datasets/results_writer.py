# SPDX-License-Identifier: MIT
"""Writes results image by image, so that an interrupted run can be resumed.

Beside ``RESULTS.csv`` is ``RESULTS.csv.progress``, whose notes each name an image and
the length of the results file with that image's rows. The rows reach the disk before
the note does, so the last whole note is true whenever the run is interrupted. To
resume, the results file is cut to that length, which drops a partial line or half an
image. An image in which nothing was found has a note but no rows, and counts as done.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from physim_drake.closing import Closing
from physim_drake.datasets.bop import ImageId
from physim_drake.datasets.results import COLUMNS, ResultRow, format_row
from physim_drake.errors import InputError
from physim_drake.poses import is_rotation
from physim_drake.storage.files import cannot_write
from physim_drake.storage.progress_file import (
    ProgressFile,
    append,
    check_in_place,
    open_to_append,
)

_HEADER = ",".join(COLUMNS) + "\n"


class ResultsWriter(Closing):
    """Appends the results of one image after another; a context manager.

    Args:
        path: results file. An existing one is replaced unless `resume`.
        resume: True to continue what an earlier run wrote to `path`, if it wrote
            anything.
        settings: settings that all parts of a run must share (names and values in
            plain text), for instance the seed and the detections.

    Attributes:
        path: results file.
        done: images that are complete.

    Raises:
        InputError: if a file cannot be written, another run is writing it, or the
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
        progress_path = path.with_name(path.name + ".progress")
        if resume and path.exists() and not progress_path.exists():
            raise InputError(
                progress_path,
                "does not exist, so it is not known which results are complete",
                "run without --resume to begin again",
            )
        self._progress = ProgressFile(progress_path, settings or {}, path)
        try:
            self._results = open_to_append(path)
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
        """Adds all rows of one image; there are none if nothing was found.

        Args:
            scene_id: scene of the image.
            im_id: image in the scene.
            rows: estimates of the image; their `time` is replaced.
            time: time that the whole image took, s.

        Raises:
            InputError: if the disk is full, or the file cannot be written or no
                longer exists.
            ValueError: if the image is done, a row belongs to another image, or a
                pose is not a rigid transform.
        """
        image = (scene_id, im_id)
        if image in self.done:
            raise ValueError(f"image {image} has already been written")
        for row in rows:
            if (row.scene_id, row.im_id) != image:
                raise ValueError(f"image {image} got a row of another image: {row}")
            if not (np.isfinite(row.X_CO).all() and is_rotation(row.X_CO[:3, :3])):
                raise ValueError(
                    f"the pose of object {row.object_id} of {image} is not a rigid "
                    "transform"
                )
        check_in_place(self._results, self.path)
        self._progress.check_in_place()
        lines = [format_row(replace(row, time=time)) + "\n" for row in rows]
        length = append(self._results, self.path, "".join(lines))
        self._progress.add({"scene_id": scene_id, "im_id": im_id, "length": length})
        self.done.add(image)

    def close(self) -> None:
        """Closes both files; the progress file stays, for a later --resume."""
        self._results.close()
        self._progress.close()

    def _begin(self, length: int) -> None:
        """Cuts the results to `length` bytes; 0 starts both files anew."""
        try:
            self._results.truncate(length)
        except OSError as error:
            raise cannot_write(self.path, error) from error
        if length == 0:
            self.done.clear()
            # The settings come last: if they are there, the results have a header.
            self._progress.clear()
            append(self._results, self.path, _HEADER)
            self._progress.begin()

    def _recover(self) -> int:
        """Reads the progress file; returns the length of the complete results."""
        notes = self._progress.recover()
        length = 0 if notes is None else len(_HEADER)
        for note in notes or ():
            length = note["length"].integer(minimum=length, maximum=1 << 60)
            self.done.add((note["scene_id"].integer(), note["im_id"].integer()))
        size = os.fstat(self._results.fileno()).st_size
        if length > size > 0:
            raise InputError(
                self.path,
                f"has {size} bytes, but {self._progress.path.name} says {length}",
                "it was changed: run without --resume to begin again",
            )
        return length if size > 0 else 0
