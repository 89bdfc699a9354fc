# SPDX-License-Identifier: MIT
"""Checks the limits of a YAML text on its events, before any value is built.

A few hundred bytes of anchors and aliases can stand for billions of values, and a key
that is given twice silently loses its first value.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import yaml
from yaml import events

MAX_YAML_BYTES = 1_000_000
"""Longest YAML file that is read."""

MAX_YAML_VALUES = 200_000
"""Greatest number of values, including those that aliases repeat."""

MAX_YAML_DEPTH = 50
"""Deepest nesting of lists and mappings."""

_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


@dataclass
class _Open:
    """A list or mapping that has not ended yet."""

    mapping: bool
    anchor: str | None
    size: int = 1
    members: int = 0
    keys: set[str] = field(default_factory=set)


def check_yaml(text: str) -> None:
    """Checks a YAML text without building its values.

    Raises:
        ValueError: if it is too large or too deep, or gives a key twice.
        yaml.YAMLError: if it is malformed.
    """
    sizes: dict[str, int] = {}
    stack = [_Open(False, None)]
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, events.CollectionStartEvent):
            mapping = isinstance(event, events.MappingStartEvent)
            stack.append(_Open(mapping, event.anchor))
            if len(stack) > MAX_YAML_DEPTH + 1:
                raise ValueError(f"nested more than {MAX_YAML_DEPTH} deep{_at(event)}")
        elif isinstance(event, events.CollectionEndEvent):
            closed = stack.pop()
            if closed.anchor is not None:
                sizes[closed.anchor] = closed.size
            _add(stack[-1], closed.size, event)
        elif isinstance(event, events.AliasEvent):
            _add(stack[-1], sizes.get(str(event.anchor), 1), event)
        elif isinstance(event, events.ScalarEvent):
            _note_key(stack[-1], event)
            _add(stack[-1], 1, event)


def _note_key(parent: _Open, event: events.ScalarEvent) -> None:
    if parent.mapping and parent.members % 2 == 0 and event.value != "<<":
        if event.value in parent.keys:
            raise ValueError(f"the key {event.value[:40]!r} is given twice{_at(event)}")
        parent.keys.add(event.value)


def _add(parent: _Open, size: int, event: events.Event) -> None:
    parent.size += size
    parent.members += 1
    if parent.size > MAX_YAML_VALUES:
        raise ValueError(f"more than {MAX_YAML_VALUES} values{_at(event)}")


def _at(event: events.Event) -> str:
    return f" (line {event.start_mark.line + 1})" if event.start_mark else ""
