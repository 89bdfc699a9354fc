# SPDX-License-Identifier: MIT
"""Reads configuration from YAML into frozen dataclasses, by Drake's typed loader.

The loader assigns to the fields, and does not support tuples, enumerations or
annotations that are strings. So it fills an editable twin of each dataclass, which is
then converted to the real one. Unknown keys are errors, as everywhere in Drake.
"""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Callable, Mapping
from enum import Enum
from functools import partial, reduce
from operator import or_
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydrake.common.yaml import yaml_load_typed

from physim_drake.errors import InputError
from physim_drake.storage.text import read_text
from physim_drake.storage.yaml_limits import MAX_YAML_BYTES, check_yaml

T = TypeVar("T")

_twins: dict[type, type] = {}
_REMEDY = "its fields are those of {}"


def load_typed_yaml(path: Path, schema: type[T], defaults: T | None = None) -> T:
    """Reads a file into a dataclass.

    Args:
        path: YAML file.
        schema: dataclass whose fields all have defaults. It may be frozen, and may
            nest dataclasses, Drake's schemas, enumerations, tuples and mappings.
        defaults: values of fields that the file omits; ``schema()`` if it is None. A
            mapping in the file replaces that of the schema, and adds to one given here.

    Raises:
        InputError: if the file cannot be read, or holds an unknown key or a value of
            another type.
    """
    text = read_text(path, MAX_YAML_BYTES, "YAML")
    return parse_typed_yaml(text, schema, defaults, str(path))


def parse_typed_yaml(
    text: str, schema: type[T], defaults: T | None = None, source: str = "YAML"
) -> T:
    """Reads a text into a dataclass; see `load_typed_yaml`.

    Args:
        text: YAML, which may be empty.
        schema: dataclass, as for `load_typed_yaml`.
        defaults: values of fields that the text omits.
        source: name of the text in messages.

    Raises:
        InputError: as `load_typed_yaml`.
    """
    start = schema() if defaults is None else defaults
    lines = (line.lstrip() for line in text.splitlines())
    if all(not line or line.startswith("#") for line in lines):
        return start
    try:
        check_yaml(text)
        loaded = yaml_load_typed(
            schema=_twin(schema),
            data=text,
            defaults=_editable(start),
            retain_map_defaults=defaults is not None,
        )
        return typing.cast(T, _final(loaded, schema))
    except NotImplementedError:
        raise  # an error of the schema, not of the file
    except InputError as error:  # a value that the dataclass itself rejects
        raise error.about(source) from error
    except (
        RuntimeError,
        ValueError,
        TypeError,
        AttributeError,
        AssertionError,
        KeyError,
        IndexError,
        OverflowError,
        yaml.YAMLError,
    ) as error:
        problem = " ".join(str(error).split())
        if isinstance(error, AssertionError | AttributeError | LookupError | TypeError):
            problem = f"a value is not of its field's type ({problem})"
        raise InputError(source, problem, _REMEDY.format(schema.__name__)) from error


def _twin(schema: type) -> type:
    """A dataclass with the same fields, which the loader can fill."""
    if schema not in _twins:
        _twins[schema] = _make_twin(schema)
    return _twins[schema]


def _make_twin(schema: type) -> type:
    hints = typing.get_type_hints(schema)
    fields = [
        (
            f.name,
            _plain(hints[f.name]),
            dataclasses.field(default_factory=partial(_default, f)),
        )
        for f in dataclasses.fields(schema)
    ]
    return dataclasses.make_dataclass(
        schema.__name__, fields, namespace={"_schema": schema}
    )


def _default(field: dataclasses.Field[Any]) -> Any:
    if field.default_factory is not dataclasses.MISSING:
        return _editable(field.default_factory())
    return _editable(field.default)


def _plain(hint: Any) -> Any:
    """The type that the loader supports for values of type `hint`."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return reduce(or_, [_plain(a) for a in arguments])
    if origin in (tuple, list):
        return list[_plain(arguments[0])]  # type: ignore[misc]
    if origin in (dict, Mapping):
        return dict[str, _plain(arguments[1])]  # type: ignore[misc]
    if isinstance(hint, type) and issubclass(hint, Enum):
        return str
    return _twin(hint) if _is_dataclass(hint) else hint


def _editable(value: Any) -> Any:
    """Converts a value of a schema for the loader."""
    if _is_dataclass(type(value)):
        names = [f.name for f in dataclasses.fields(value)]
        return _twin(type(value))(
            **{name: _editable(getattr(value, name)) for name in names}
        )
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, tuple | list):
        return [_editable(v) for v in value]
    if isinstance(value, Mapping):
        return {key: _editable(v) for key, v in value.items()}
    return value


def _final(value: Any, hint: Any) -> Any:
    """Converts a loaded value to the types of its schema."""
    schema = getattr(type(value), "_schema", None)
    if schema is not None:
        hints = typing.get_type_hints(schema)
        return schema(
            **{name: _final(getattr(value, name), h) for name, h in hints.items()}
        )
    arguments = typing.get_args(hint)
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        enums = [a for a in arguments if _is_enum(a)]
        return _final(value, enums[0]) if enums and value is not None else value
    if isinstance(value, list):
        return _container(hint)(_final(v, arguments[0]) for v in value)
    if isinstance(value, dict):
        return {key: _final(v, arguments[1]) for key, v in value.items()}
    return _member(hint, value) if _is_enum(hint) else value


def _container(hint: Any) -> Callable[[Any], Any]:
    return tuple if typing.get_origin(hint) is tuple else list


def _member(kind: type[Enum], value: str) -> Enum:
    try:
        return kind(value)
    except ValueError:
        known = ", ".join(str(member.value) for member in kind)
        raise ValueError(f"{value!r} is not one of {known}") from None


def _is_enum(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, Enum)


def _is_dataclass(hint: Any) -> bool:
    return isinstance(hint, type) and dataclasses.is_dataclass(hint)
