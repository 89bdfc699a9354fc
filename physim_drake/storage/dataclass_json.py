# SPDX-License-Identifier: MIT
"""Converts dataclasses to JSON and back; numbers keep every digit."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping
from enum import Enum
from typing import Any, TypeVar

import numpy as np

from physim_drake.storage.json_nodes import JsonNode
from physim_drake.storage.type_hints import without_alias

T = TypeVar("T")


def to_plain(value: Any) -> Any:
    """Converts a dataclass to values that JSON has.

    Args:
        value: a dataclass, enumeration, array, mapping with keys of text, sequence,
            number, text or None; its members are of these types as well.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        names = [f.name for f in dataclasses.fields(value)]
        return {name: to_plain(getattr(value, name)) for name in names}
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: to_plain(v) for key, v in value.items()}
    if isinstance(value, tuple | list):
        return [to_plain(v) for v in value]
    return value


def from_plain(node: JsonNode, schema: type[T]) -> T:
    """Converts what `to_plain` returned back to the dataclass.

    Args:
        node: the converted value, read from a file.
        schema: the dataclass.

    Raises:
        InputError: if the node does not hold such a value.
    """
    hints = typing.get_type_hints(schema)
    members = _members(node)
    for name in hints:
        if name not in members:
            node.fail(f'has no "{name}"')
    return schema(**{name: _read(members[name], h) for name, h in hints.items()})


def _members(node: JsonNode) -> dict[str, JsonNode]:
    """Members of an object, which may be null."""
    if not isinstance(node.value, dict):
        node.fail("is not an object {...}")
    start = f"{node.place}." if node.place else ""
    return {
        name: JsonNode(value, node.source, start + name)
        for name, value in node.value.items()
    }


def _read(node: JsonNode, hint: Any) -> Any:
    """A value of type `hint`."""
    hint = without_alias(hint)
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        if node.value is None and type(None) in arguments:
            return None
        (hint,) = (a for a in arguments if a is not type(None))
        return _read(node, hint)
    if origin is tuple:
        return _tuple(node, arguments)
    if origin is Mapping:
        return {name: _read(v, arguments[1]) for name, v in _members(node).items()}
    if origin is np.ndarray:
        return _array(node)
    if dataclasses.is_dataclass(hint):
        return from_plain(node, typing.cast(type, hint))
    return _scalar(node, hint)


def _tuple(node: JsonNode, hints: tuple[Any, ...]) -> tuple[Any, ...]:
    items = list(node.elements())
    if len(hints) == 2 and hints[1] is Ellipsis:
        hints = hints[:1] * len(items)
    if len(items) != len(hints):
        node.fail(f"is a list of {len(items)}", f"it must be a list of {len(hints)}")
    return tuple(_read(i, hint) for i, hint in zip(items, hints, strict=True))


def _array(node: JsonNode) -> np.ndarray[Any, np.dtype[np.float64]]:
    try:
        return np.array(node.value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        node.fail("is not an array of numbers")


def _scalar(node: JsonNode, kind: type) -> Any:
    value = node.value
    if issubclass(kind, Enum):
        try:
            return kind(value)
        except ValueError:
            node.fail(f"is not one of {', '.join(str(m.value) for m in kind)}")
    if kind is float and type(value) is int and abs(value) < 1 << 53:
        return float(value)
    if type(value) is not kind:
        node.fail(f"is not of type {kind.__name__}")
    return value
