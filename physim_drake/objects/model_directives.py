# SPDX-License-Identifier: MIT
"""Writes Drake model directives: the YAML that puts models into a plant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

Directive = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Tagged:
    """A mapping with one of Drake's tags.

    Attributes:
        tag: for instance ``!Rpy``.
        fields: the mapping.
    """

    tag: str
    fields: Mapping[str, Any]


@dataclass(frozen=True)
class Fixed:
    """A number, or a list of numbers on one line, to a fixed number of decimals.

    Attributes:
        value: the number or numbers.
        decimals: digits after the point.
    """

    value: float | Sequence[float]
    decimals: int


def add_model(name: str, uri: str, X_WB: Mapping[str, Any] | None = None) -> Directive:
    """Adds a model.

    Args:
        name: name of the model instance.
        uri: URI of its file.
        X_WB: pose of its link `body` if that is free, as Drake's schema for
            transforms has it.
    """
    fields: dict[str, Any] = {"name": name, "file": uri}
    if X_WB is not None:
        fields["default_free_body_pose"] = {"body": X_WB}
    return {"add_model": fields}


def add_frame(name: str, X_WF: Mapping[str, Any]) -> Directive:
    """Adds a frame.

    Args:
        name: name of the frame.
        X_WF: its pose, as Drake's schema for transforms has it.
    """
    return {"add_frame": {"name": name, "X_PF": {"base_frame": "world", **X_WF}}}


def add_weld(parent: str, child: str) -> Directive:
    """Welds a frame to another one."""
    return {"add_weld": {"parent": parent, "child": child}}


def directives_text(directives: Sequence[Directive]) -> str:
    """The text of a file for `pydrake.multibody.parsing.LoadModelDirectives`."""
    return yaml.dump(
        {"directives": list(directives)},
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
    )


class _Dumper(yaml.SafeDumper):
    """Writes the classes above as well; a class of its own, as representers are."""


def _tagged(dumper: _Dumper, value: Tagged) -> yaml.Node:
    return dumper.represent_mapping(value.tag, value.fields)


def _fixed(dumper: _Dumper, value: Fixed) -> yaml.Node:
    if not isinstance(value.value, Sequence):
        text = f"{value.value:.{value.decimals}f}"
        return dumper.represent_scalar("tag:yaml.org,2002:float", text)
    items = [Fixed(item, value.decimals) for item in value.value]
    return dumper.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=True)


_Dumper.add_representer(Tagged, _tagged)
_Dumper.add_representer(Fixed, _fixed)
