# SPDX-License-Identifier: MIT
"""Reads JSON files value by value; each check names the file and the field."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from physim_drake.errors import InputError
from physim_drake.poses import Array
from physim_drake.storage.text import read_text

MAX_JSON_BYTES = 512_000_000
"""Longest JSON file that is read."""

MAX_ID = 999_999
"""Largest scene, image or object id: BOP writes them with six digits."""


@dataclass(frozen=True)
class JsonNode:
    """A value of a JSON file with its place in it.

    Attributes:
        value: value as `json` returns it.
        source: path of the file.
        place: path from the root to the value, for instance ``[3].bbox``.
    """

    value: Any
    source: Path
    place: str = ""

    def fail(self, problem: str, remedy: str = "") -> NoReturn:
        """Raises the `InputError` for this value."""
        raise InputError(self.source, problem, remedy, self.place or None)

    def __getitem__(self, key: str) -> JsonNode:
        """The member `key` of an object; raises `InputError` if it is missing."""
        member = self.get(key)
        if member is None:
            self.fail(f'has no "{key}"', f'add the field "{key}" as BOP describes it')
        return member

    def get(self, key: str) -> JsonNode | None:
        """The member `key` of an object, or None if it is absent or null."""
        if not isinstance(self.value, dict):
            self.fail(f"is {_show(self.value)}", "it must be an object {...}")
        value = self.value.get(key)
        place = f"{self.place}.{key}" if self.place else key
        return None if value is None else JsonNode(value, self.source, place)

    def by_id(self) -> dict[int, JsonNode]:
        """The members of an object whose keys are ids, in ascending order.

        Raises:
            InputError: if a key is not an id, or two keys are the same id.
        """
        if not isinstance(self.value, dict):
            self.fail(f"is {_show(self.value)}", "it must be an object keyed by ids")
        members: dict[int, JsonNode] = {}
        for key, value in self.value.items():
            place = f"{self.place}.{key}" if self.place else key
            node = JsonNode(value, self.source, place[:200])
            if not (key.isascii() and key.isdigit() and len(key) <= 6):
                node.fail(f"key {_show(key)}", f"keys must be ids, 0 to {MAX_ID}")
            if int(key) in members:
                node.fail(f"id {int(key)} is given twice", "keep one of them")
            members[int(key)] = node
        return dict(sorted(members.items()))

    def elements(self) -> Iterator[JsonNode]:
        """The elements of a list."""
        if not isinstance(self.value, list):
            self.fail(f"is {_show(self.value)}", "it must be a list [...]")
        for index, value in enumerate(self.value):
            yield JsonNode(value, self.source, f"{self.place}[{index}]")

    def integer(self, minimum: int = 0, maximum: int = MAX_ID) -> int:
        """The value as an int within both limits."""
        value = self.value
        if isinstance(value, bool) or not isinstance(value, int):
            self.fail(f"is {_show(value)}", "it must be an integer")
        if not minimum <= value <= maximum:
            self.fail(f"is {_show(value)}", f"it must lie in {minimum}..{maximum}")
        return value

    def number(self, minimum: float = -math.inf, maximum: float = math.inf) -> float:
        """The value as a finite float within both limits."""
        value = _as_float(self.value)
        if value is None:
            self.fail(f"is {_show(self.value)}", "it must be a finite number")
        if not minimum <= value <= maximum:
            self.fail(f"is {value:g}", f"it must lie in {minimum:g}..{maximum:g}")
        return value

    def array(self, *shape: int) -> Array:
        """The list of finite numbers, rows first, as an array of `shape`."""
        count = math.prod(shape)
        if not isinstance(self.value, list) or len(self.value) != count:
            self.fail(f"is {_show(self.value)}", f"it must be a list of {count}")
        numbers = [_as_float(value) for value in self.value]
        if None in numbers:
            wrong = self.value[numbers.index(None)]
            self.fail(f"holds {_show(wrong)}", f"it must be {count} finite numbers")
        return np.array(numbers, dtype=float).reshape(shape)


def read_json(path: Path) -> JsonNode:
    """Reads a JSON file; if it is malformed, raises `InputError` with the line."""
    text = read_text(path, MAX_JSON_BYTES, "JSON")
    try:
        return JsonNode(parse_json(text), path)
    except json.JSONDecodeError as error:
        raise InputError(
            path,
            f"is not valid JSON: {error.msg} (line {error.lineno}, "
            f"column {error.colno})",
            "correct it or write it again",
        ) from None
    except (ValueError, RecursionError) as error:
        raise InputError(
            path, f"is not valid JSON: {error}", "correct it or write it again"
        ) from None


def parse_json(text: str | bytes) -> Any:
    """The value of a JSON text.

    Raises:
        ValueError: if it is malformed, gives a key twice, or holds NaN.
        RecursionError: if it is nested some thousand deep.
    """
    return json.loads(
        text, parse_constant=_reject_constant, object_pairs_hook=_without_repeats
    )


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    members = dict(pairs)
    if len(members) != len(pairs):
        twice = next(k for k, n in Counter(k for k, _ in pairs).items() if n > 1)
        raise ValueError(f"the key {_show(twice)} is given twice")
    return members


def _reject_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


def _as_float(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def _show(value: object) -> str:
    """`value` on one line and short enough for a message."""
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, dict):
        return f"an object of {len(value)}"
    try:
        text = ascii(value)
    except ValueError:  # an int of more digits than Python prints
        text = "a huge integer"
    return text if len(text) <= 40 else text[:37] + "..."
