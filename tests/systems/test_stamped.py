# SPDX-License-Identifier: MIT
from __future__ import annotations

import copy
from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.common.value import Value

from physim_drake.systems.stamped import LookState, Stamped, fits, type_name
from tests.storage.test_type_hints import Alias


def test_copies_share_what_is_in_them() -> None:
    image = np.zeros((4, 5))
    stamped = Stamped(image, 1.5, 2)
    assert copy.deepcopy(stamped) is stamped
    assert copy.copy(stamped) is stamped
    assert Value(stamped).Clone().get_value() is stamped


@pytest.mark.parametrize(
    ("value", "kind", "name", "yes"),
    [
        (3, int, "int", True),
        ("3", int, "int", False),
        ((), tuple[int, ...], "tuple[int, ...]", True),
        ((1, 2), tuple[int, ...], "tuple[int, ...]", True),
        ((1, "2"), tuple[int, ...], "tuple[int, ...]", False),
        ([1], tuple[int, ...], "tuple[int, ...]", False),
        (np.zeros(3), NDArray[np.int16], "ndarray", True),
        ([0.0], NDArray[np.int16], "ndarray", False),
        (np.zeros(3), Alias(NDArray[np.int16]), "ndarray", True),
        ([0.0], Alias(NDArray[np.int16]), "ndarray", False),
        ((np.zeros(3),), tuple[Alias(NDArray), ...], "tuple[ndarray, ...]", True),  # type: ignore[misc]
        ({"a": 1}, Mapping[str, int], "Mapping[str, int]", True),
        ({"a": ""}, Mapping[str, int], "Mapping[str, int]", False),
        (3, Mapping[str, int], "Mapping[str, int]", False),
    ],
)
def test_types_are_told_apart_and_named(
    value: object, kind: object, name: str, yes: bool
) -> None:
    assert fits(value, kind) is yes
    assert type_name(kind) == name


def test_results_are_shown_when_they_are_due_one_at_a_time() -> None:
    state = LookState((Stamped(),))
    one, two = (Stamped("a", 0.0, 1),), (Stamped("b", 0.1, 2),)
    state = state.with_results(1, one, 1.0).with_results(2, two, 1.1)
    assert state.done == 2
    assert state.at(0.9) is state
    # The sum of ten steps of 0.1 s is a little less than one second.
    assert state.at(sum([0.1] * 10)).shown == one
    assert state.at(2.0).shown == one
    assert state.at(2.0).at(2.0).shown == two
    settled = state.at(2.0).at(2.0)
    assert settled.at(3.0) is settled
