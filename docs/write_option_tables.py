# SPDX-License-Identifier: MIT
"""Writes the tables of options in docs/cli.md from the commands' own help.

python docs/write_option_tables.py
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from enum import Enum
from pathlib import Path
from typing import Any, get_args

import typer
from typer.models import ArgumentInfo, OptionInfo

from physim_drake.cli import app

PAGE = Path(__file__).parent / "cli.md"
SHARED = {"quiet", "log_level"}
"""Options that the page describes once for all commands."""

_BLOCK = re.compile(
    r"(<!-- options of (?P<command>[a-z -]+?) -->\n).*?(<!-- end of options -->\n)",
    re.DOTALL,
)
_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
_HEAD = "| | default | meaning |\n|---|---|---|\n"


def commands(of: typer.Typer = app) -> dict[str, Callable[..., None]]:
    """The functions of the commands by name, as in "estimate" and "models check"."""
    found = {}
    for command in of.registered_commands:
        assert command.callback is not None
        found[command.name or command.callback.__name__.replace("_", "-")] = (
            command.callback
        )
    for group in of.registered_groups:
        assert group.typer_instance is not None
        below = commands(group.typer_instance)
        found |= {f"{group.name} {name}": command for name, command in below.items()}
    return found


def rewritten(page: str) -> str:
    """The page with the tables that the commands have now."""
    known = commands()

    def table(block: re.Match[str]) -> str:
        rows = "".join(_rows(known[block["command"]]))
        return f"{block[1]}\n{_HEAD}{rows}\n{block[3]}"

    return _BLOCK.sub(table, page)


def _rows(command: Callable[..., None]) -> Iterator[str]:
    """The rows of a command's table."""
    for name, parameter in inspect.signature(command, eval_str=True).parameters.items():
        kind, info = get_args(parameter.annotation)
        if name not in SHARED:
            names, meaning = _names(name, kind, info), _meaning(kind, info)
            default = _default(parameter.default, info)
            yield f"| {names} | {default} | {meaning} |\n".replace("|  |", "| |")


def _names(name: str, kind: Any, info: ArgumentInfo | OptionInfo) -> str:
    """What is written on the command line, with the name of the value."""
    if isinstance(info, ArgumentInfo):
        return f"`{info.metavar or name.upper()}`"
    flag = f"--{name.replace('_', '-')}"
    # In `Annotated`, Typer takes the first name for the default.
    given = [d for d in (info.default, *(info.param_decls or ())) if d is not ...]
    declared = given[0] if given else flag
    if kind is bool:
        both = "" if given else f"/--no-{flag.removeprefix('--')}"
        return ", ".join(f"`{text}`" for text in f"{declared}{both}".split("/"))
    values = (info.metavar or _value(kind)).split("|")
    return ", ".join(f"`{declared} {value}`" for value in values)


def _value(kind: Any) -> str:
    """What a value is called that has no name of its own."""
    kinds = get_args(kind) or (kind,)
    if any(isinstance(k, type) and issubclass(k, Enum) for k in kinds):
        return "NAME"
    return "N" if int in kinds else "X" if float in kinds else "TEXT"


def _default(default: Any, info: ArgumentInfo | OptionInfo) -> str:
    if default is inspect.Parameter.empty:
        return "required"
    if isinstance(info.show_default, str):
        return _marked(info.show_default)
    if default is True:
        return "yes"
    # 0 equals False in Python, but it is a default to print.
    return "" if default is None or default is False else f"`{default}`"


def _meaning(kind: Any, info: ArgumentInfo | OptionInfo) -> str:
    text = _marked(info.help or "")
    for choice in get_args(kind) or (kind,):
        if isinstance(choice, type) and issubclass(choice, Enum):
            text += f" One of {', '.join(f'`{item.value}`' for item in choice)}."
    return text


def _marked(text: str) -> str:
    """A help text as Markdown."""
    return _OPTION.sub(r"`\g<0>`", text.replace("*", r"\*").replace("|", r"\|"))


if __name__ == "__main__":
    PAGE.write_text(rewritten(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
