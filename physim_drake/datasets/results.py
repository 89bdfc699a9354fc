# SPDX-License-Identifier: MIT
"""Reads and writes results in the CSV format of the BOP challenge.

A row is ``scene_id,im_id,obj_id,score,R,t,time``. R holds 9 numbers, rows first, and t
holds 3 numbers in millimetres, both separated by blanks. The time is in seconds for the
whole image, the same in each of its rows, and -1 if it is not known.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np

from physim_drake.datasets.scene_files import MAX_TRANSLATION_MM
from physim_drake.errors import InputError
from physim_drake.poses import Array, is_rotation, make_pose, nearest_rotation
from physim_drake.storage.json_nodes import MAX_ID
from physim_drake.storage.text import read_text

MAX_RESULTS_BYTES = 512_000_000
"""Longest results file that is read."""

COLUMNS = ("scene_id", "im_id", "obj_id", "score", "R", "t", "time")
_ROTATION_TOLERANCE = 1e-2
_MAX_TIME = 1e9


@dataclass(frozen=True)
class ResultRow:
    """One estimated object.

    Attributes:
        scene_id: scene of the image.
        im_id: image in the scene.
        object_id: id of the object.
        score: confidence, of which only the order counts.
        X_CO: its pose in the camera, (4, 4), m.
        time: seconds for the whole image, or None if it is not known.
    """

    scene_id: int
    im_id: int
    object_id: int
    score: float
    X_CO: Array
    time: float | None = None


def format_row(row: ResultRow) -> str:
    """The line of `row` with 12 significant digits, without a line end."""
    rotation = nearest_rotation(row.X_CO[:3, :3])
    values = (
        f"{row.score:.9g}",
        _blank_separated(rotation),
        _blank_separated(row.X_CO[:3, 3] * 1e3),
        f"{-1 if row.time is None else row.time:.6g}",
    )
    return ",".join([f"{row.scene_id},{row.im_id},{row.object_id}", *values])


def read_results(path: Path) -> list[ResultRow]:
    """Reads a results file; rotations are made orthonormal again.

    Raises:
        InputError: if the file cannot be read or lacks a column, or a row is
            malformed; the error names the line.
    """
    file = StringIO(read_text(path, MAX_RESULTS_BYTES, "CSV"), newline="")
    try:
        lines = csv.reader(file, skipinitialspace=True, strict=True)
        columns = _read_header(path, next(lines, []))
        return [
            _read_row(_Line(path, lines.line_num, columns, values))
            for values in lines
            if values
        ]
    except csv.Error as error:
        raise InputError(path, f"is not CSV text: {error}", "write it again") from None


@dataclass(frozen=True)
class _Line:
    """A line's values with what messages about them need."""

    path: Path
    number: int
    columns: dict[str, int]
    values: list[str]

    def text(self, column: str) -> str:
        index = self.columns[column]
        return self.values[index].strip() if index < len(self.values) else ""

    def fail(self, column: str, remedy: str) -> InputError:
        text = self.text(column)
        shown = ascii(text if len(text) <= 40 else text[:37] + "...")
        return InputError(
            self.path, f"is {shown}", remedy, f"line {self.number}, {column}"
        )

    def floats(self, column: str, count: int) -> Array:
        try:
            numbers = [float(v) for v in self.text(column).replace(",", " ").split()]
        except ValueError:
            numbers = []
        if len(numbers) != count or not all(map(math.isfinite, numbers)):
            raise self.fail(column, f"give {count} finite number(s)")
        return np.array(numbers)

    def id(self, column: str) -> int:
        number = float(self.floats(column, 1)[0])
        if not (number.is_integer() and 0 <= number <= MAX_ID):
            raise self.fail(column, f"give an integer in 0..{MAX_ID}")
        return int(number)


def _read_header(path: Path, names: list[str]) -> dict[str, int]:
    columns = {name.strip(): index for index, name in enumerate(names)}
    missing = [name for name in COLUMNS[:-1] if name not in columns]
    if missing:
        raise InputError(
            path,
            f"the first line lacks {', '.join(missing)}",
            f"it must be {','.join(COLUMNS)}",
        )
    return columns


def _read_row(line: _Line) -> ResultRow:
    if len(line.values) != len(line.columns):
        raise InputError(
            line.path,
            f"has {len(line.values)} columns, the first line {len(line.columns)}",
            "complete or remove the line",
            f"line {line.number}",
        )
    R = line.floats("R", 9).reshape(3, 3)
    if not is_rotation(R, _ROTATION_TOLERANCE):
        raise line.fail("R", "give a right-handed rotation, rows first")
    t_mm = line.floats("t", 3)
    if np.abs(t_mm).max() > MAX_TRANSLATION_MM:
        raise line.fail("t", "translations are in millimetres")
    has_time = "time" in line.columns and line.text("time") != ""
    time = float(line.floats("time", 1)[0]) if has_time else -1.0
    if time > _MAX_TIME:
        raise line.fail("time", "give seconds, or -1")
    return ResultRow(
        line.id("scene_id"),
        line.id("im_id"),
        line.id("obj_id"),
        float(line.floats("score", 1)[0]),
        make_pose(nearest_rotation(R), t_mm * 1e-3),
        time if time >= 0 else None,
    )


def _blank_separated(numbers: Array) -> str:
    return " ".join(f"{number:.12g}" for number in numbers.flat)
