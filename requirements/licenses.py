# SPDX-License-Identifier: MIT
"""Writes THIRD-PARTY-LICENSES.md from the metadata of what is installed.

python requirements/licenses.py
"""

from __future__ import annotations

import importlib.metadata
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "THIRD-PARTY-LICENSES.md"

_HEAD = """\
# Licences of what physim-drake uses

physim-drake itself is under the MIT licence ([LICENSE](LICENSE)). It contains no code
of others and installs the packages below with `pip`, each under its own licence. This
page is written by `python requirements/licenses.py` from the metadata of the installed
packages; the licence texts are in their `dist-info` folders.

"""
_NOTES = {
    "drake": "its wheel holds other libraries, with their licences in `pydrake/doc`",
    "matplotlib": "Drake asks for it, too",
    "mosek": "proprietary: Drake asks for it; physim-drake works without its licence",
    "opencv-python-headless": "its wheel holds other libraries, among them FFmpeg "
    "(LGPL 2.1); see its `LICENSE-3RD-PARTY.txt`",
    "torch": "from PyPI, on Linux, it brings NVIDIA's CUDA libraries, which are "
    "proprietary; its CPU build does not",
}


def main() -> None:
    """Writes the page."""
    PAGE.write_text(page(), encoding="utf-8")


def page() -> str:
    """The page's text."""
    direct = direct_names()
    indirect = sorted(closure(direct) - set(direct))
    return (
        f"{_HEAD}## What it asks for\n\n{table(direct)}\n"
        f"## What these bring along (Python 3.11, Linux)\n\n{table(indirect)}"
    )


def direct_names() -> list[str]:
    """The packages that pyproject.toml asks for, those to work on the project apart."""
    return sorted(asked_for())


def asked_for() -> dict[str, list[str]]:
    """These packages, and for each the extras with it where the base is without."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    found: dict[str, list[str]] = {
        _normal(Requirement(text).name): [] for text in project["dependencies"]
    }
    for extra, texts in project["optional-dependencies"].items():
        if extra not in ("all", "dev", "docs", "fuzz"):
            for text in texts:
                found.setdefault(_normal(Requirement(text).name), []).append(extra)
    return found


def closure(names: Iterable[str]) -> set[str]:
    """These installed packages, and all that they need here."""
    found: set[str] = set()
    todo = list(names)
    while todo:
        name = _normal(todo.pop())
        if name in found:
            continue
        found.add(name)
        for text in importlib.metadata.requires(name) or ():
            requirement = Requirement(text)
            marker = requirement.marker
            if marker is None or marker.evaluate({"extra": ""}):
                todo.append(requirement.name)
    return found


def table(names: Iterable[str]) -> str:
    """A row a package."""
    rows = ["| package | licence | note |", "|---|---|---|"]
    for name in names:
        rows.append(f"| {name} | {license_of(name)} | {note_on(name)} |")
    return "\n".join(rows) + "\n"


def note_on(name: str) -> str:
    """Which extras a package is for, where the base does without, and more."""
    extras = asked_for().get(name)
    only = f"extra {', '.join(extras)}" if extras else ""
    return "; ".join(text for text in (only, _NOTES.get(name)) if text)


def license_of(name: str) -> str:
    """What the metadata of an installed package says its licence is."""
    metadata = importlib.metadata.metadata(name)
    if expression := metadata.get("License-Expression"):
        return str(expression)
    text = str(metadata.get("License") or "").strip()
    # Some give the whole text, and some say less than their classifiers.
    if text and len(text) < 60 and "\n" not in text and text != "Various":
        return text
    prefix = "License ::"
    classifiers = [
        c.rsplit("::", 1)[-1].strip()
        for c in metadata.get_all("Classifier") or ()
        if c.startswith(prefix)
    ]
    if not classifiers:
        raise SystemExit(f"{name}: its metadata names no licence; see its files")
    return "; ".join(classifiers)


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


if __name__ == "__main__":
    main()
