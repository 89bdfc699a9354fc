# SPDX-License-Identifier: MIT
"""The extras of the package: what needs more than the base installation."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass

from physim_drake.errors import InputError


@dataclass(frozen=True)
class Extra:
    """Packages that only some commands need.

    Attributes:
        packages: names that they are imported by.
        purpose: use of the extra, as messages name it.
    """

    packages: tuple[str, ...]
    purpose: str


EXTRAS: Mapping[str, Extra] = {
    "ray": Extra(("ray",), "several machines, with --engine ray"),
    "train": Extra(
        ("torch", "safetensors", "pycocotools", "matplotlib"),
        "networks that detect objects",
    ),
    "viz": Extra(
        ("jinja2", "markupsafe", "matplotlib"),
        "the pages of report, explain and pick --record",
    ),
}
"""By name. What pip installs for them is in pyproject.toml."""


def need_extra(name: str) -> None:
    """Imports an extra, or says how to install it.

    Args:
        name: key of `EXTRAS`.

    Raises:
        InputError: naming the package that is missing.
    """
    for package in EXTRAS[name].packages:
        try:
            importlib.import_module(package)
        except ModuleNotFoundError as error:
            raise InputError(
                error.name or package,
                f"is not installed (extra [{name}])",
                install_command(name),
            ) from None


def install_command(*names: str) -> str:
    """The command that installs some extras."""
    return f"pip install 'physim-drake[{','.join(names)}]'"
