# SPDX-License-Identifier: MIT
from __future__ import annotations

import types
from typing import Any, TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray

from physim_drake.storage.type_hints import without_alias

T = TypeVar("T")


class Alias:
    """What Python 3.12 makes of ``type Alias[T] = value``."""

    def __init__(self, value: Any) -> None:
        self.__value__ = value

    def __getitem__(self, arguments: Any) -> types.GenericAlias:
        return types.GenericAlias(self, arguments)  # type: ignore[arg-type]

    def __call__(self) -> None:
        """`typing.get_type_hints` takes what can be called for a type."""


@pytest.mark.parametrize(
    ("hint", "resolved"),
    [
        (int, int),
        (float | None, float | None),
        (tuple[int, ...], tuple[int, ...]),
        (NDArray, np.ndarray),
        (Alias(int), int),
        (Alias(Alias(tuple[int, str])), tuple[int, str]),
        (Alias(tuple[T, ...])[int], tuple[int, ...]),  # type: ignore[valid-type]
        (Alias(dict[str, T])[Alias(int)], dict),  # type: ignore[valid-type]
    ],
)
def test_an_alias_is_the_type_that_it_stands_for(hint: Any, resolved: Any) -> None:
    found = without_alias(hint)
    if resolved in (np.ndarray, dict):
        found = found.__origin__
    assert found == resolved
