# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physim_drake.errors import InputError
from physim_drake.observation.support_surface import SupportSurface
from physim_drake.poses import Array
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate, SearchTrace
from physim_drake.storage.dataclass_json import from_plain, to_plain
from physim_drake.storage.json_nodes import JsonNode
from tests.storage.test_type_hints import Alias

FILE = Path("notes")


class Color(StrEnum):
    RED = "red"


@dataclass(frozen=True)
class Inner:
    pair: tuple[int, str]
    points: Array


@dataclass(frozen=True)
class Outer:
    number: float
    count: int
    flag: bool
    name: str
    color: Color
    maybe: float | None
    items: tuple[Inner, ...]
    times: Mapping[str, float]


@dataclass(frozen=True)
class Aliased:
    points: Alias(Array)  # type: ignore[valid-type]


VALUE = Outer(
    0.1 + 0.2,
    3,
    True,
    "é\n",
    Color.RED,
    None,
    (Inner((1, "a"), np.random.default_rng(0).normal(size=(2, 3))),),
    {"b": 1e-300, "a": 2.0},
)


def through_a_file(value: Any) -> Any:
    node = JsonNode(json.loads(json.dumps(to_plain(value))), FILE)
    return from_plain(node, type(value))


def test_every_digit_comes_back() -> None:
    again = through_a_file(VALUE)
    np.testing.assert_array_equal(again.items[0].points, VALUE.items[0].points)
    assert to_plain(again) == to_plain(VALUE)
    assert again.color is Color.RED
    assert list(again.times) == ["b", "a"]


def test_numbers_of_arrays_are_plain_ones() -> None:
    value = Inner((np.int64(7), "a"), np.zeros((0, 3)))  # type: ignore[arg-type]
    again = through_a_file(value)
    assert type(again.pair[0]) is int


def test_an_estimate_comes_back() -> None:
    rng = np.random.default_rng(1)
    X_CO = rng.normal(size=(4, 4))
    found = ObjectEstimate(3, "soap", X_CO, X_CO @ X_CO, 0.7, "")
    missing = ObjectEstimate(4, "ball", None, None, 0.0, "too few points")
    trace = SearchTrace((0,), ((1, 0.25, 77, X_CO[None]),), 12)
    surface = SupportSurface(X_CO, np.eye(4))
    estimate = SceneEstimate((found, missing), surface, "mcts", {"load": 1.0}, (trace,))
    again = through_a_file(estimate)
    assert to_plain(again) == to_plain(estimate)
    np.testing.assert_array_equal(again.objects[0].X_CO, X_CO)
    assert again.objects[1].X_CO is None
    assert again.trace[0].points[0][3].shape == (1, 4, 4)


@pytest.mark.parametrize(
    ("name", "wrong", "message"),
    [
        ("number", "1", "notes: number: is not of type float"),
        ("number", 10**400, "notes: number: is not of type float"),
        ("count", 1.5, "notes: count: is not of type int"),
        ("count", True, "notes: count: is not of type int"),
        ("flag", 1, "notes: flag: is not of type bool"),
        ("color", "blue", "notes: color: is not one of red"),
        ("items", {}, "notes: items: is an object of 0"),
        ("items", [3], r"notes: items\[0\]: is not an object"),
        ("items", [{"pair": [1], "points": []}], r"items\[0\].pair: is a list of 1"),
        (
            "items",
            [{"pair": [1, "a"], "points": [[1], [1, 2]]}],
            r"items\[0\].points: is not an array of numbers",
        ),
        ("times", [], "notes: times: is not an object"),
    ],
)
def test_what_is_something_else_is_named(name: str, wrong: Any, message: str) -> None:
    plain = to_plain(VALUE) | {name: wrong}
    with pytest.raises(InputError, match=message):
        from_plain(JsonNode(plain, FILE), Outer)


def test_what_is_missing_is_named() -> None:
    plain = to_plain(VALUE)
    del plain["flag"]
    with pytest.raises(InputError, match='has no "flag"'):
        from_plain(JsonNode(plain, FILE), Outer)


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner),
)


@given(
    st.fixed_dictionaries(
        dict.fromkeys(asdict(VALUE), values), optional={"more": values}
    )
)
def test_whatever_a_file_holds_nothing_but_input_errors_come(plain: Any) -> None:
    with suppress(InputError):
        from_plain(JsonNode(plain, FILE), Outer)


def test_a_field_may_have_the_type_of_an_alias() -> None:
    node = JsonNode({"points": [[0.5, 1.0]]}, FILE)
    assert np.array_equal(from_plain(node, Aliased).points, [[0.5, 1.0]])
