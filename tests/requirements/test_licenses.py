# SPDX-License-Identifier: MIT
from __future__ import annotations

import email.message
import importlib.metadata
import re
import runpy
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
SCRIPT: dict[str, Any] = runpy.run_path(str(ROOT / "requirements" / "licenses.py"))


def rows() -> dict[str, str]:
    """The packages of the page and their licences."""
    text = (ROOT / "THIRD-PARTY-LICENSES.md").read_text()
    found = re.findall(r"^\| ([a-z0-9-]+) \| (.*?) \|", text, re.MULTILINE)
    return {name: license for name, license in found if name != "package"}


def test_every_dependency_is_on_the_page() -> None:
    names = SCRIPT["direct_names"]()
    assert "drake" in names
    assert [name for name in names if not rows().get(name)] == []


def test_the_page_says_what_the_installed_metadata_says() -> None:
    listed = rows()
    for name in SCRIPT["direct_names"]():
        assert listed[name] == SCRIPT["license_of"](name), name


def test_what_dependencies_bring_is_on_the_page_too() -> None:
    needed = SCRIPT["closure"](["matplotlib"])
    assert {"contourpy", "cycler", "kiwisolver"} <= needed
    assert needed <= set(rows())


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"License-Expression": "MIT", "License": "other"}, "MIT"),
        ({"License": "BSD 2"}, "BSD 2"),
        ({"License": "a\nwhole text", "Classifier": "License :: OSI :: ISC"}, "ISC"),
        ({"License": "Various", "Classifier": "License :: OSI :: ISC"}, "ISC"),
    ],
)
def test_licence_of_a_package(
    fields: dict[str, str], expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    metadata = email.message.Message()
    for key, value in fields.items():
        metadata[key] = value
    monkeypatch.setattr(importlib.metadata, "metadata", lambda _: metadata)
    assert SCRIPT["license_of"]("some") == expected


def test_a_package_without_a_licence_is_not_passed_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        importlib.metadata, "metadata", lambda _: email.message.Message()
    )
    with pytest.raises(SystemExit, match="some: its metadata names no licence"):
        SCRIPT["license_of"]("some")
