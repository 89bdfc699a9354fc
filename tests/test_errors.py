# SPDX-License-Identifier: MIT
from __future__ import annotations

import pytest

from physim_drake.errors import InputError


@pytest.mark.parametrize(
    ("field", "text"),
    [
        (None, "cell.yaml: look: is empty; give one"),
        ("views", "cell.yaml: look: views: is empty; give one"),
    ],
)
def test_an_error_about_a_part_becomes_one_about_the_whole(
    field: str | None, text: str
) -> None:
    error = InputError("look", "is empty", "give one", field)
    assert str(error.about("cell.yaml")) == text


def test_an_error_names_its_source_once() -> None:
    error = InputError("cell.yaml", "is empty", field="views")
    assert str(error.about("cell.yaml")) == "cell.yaml: views: is empty"
