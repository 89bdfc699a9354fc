# SPDX-License-Identifier: MIT
"""What holds for the options of all commands."""

from __future__ import annotations

import re
from typing import Any

import pytest
import typer

from physim_drake.cli import app

COMMANDS: dict[str, Any] = typer.main.get_command(app).commands  # type: ignore[attr-defined]
LONG = sorted(set(COMMANDS) - {"doctor"})


@pytest.mark.parametrize("name", LONG)
def test_a_command_that_takes_long_can_be_quiet_or_tell_more(name: str) -> None:
    command = COMMANDS[name]
    for shown in getattr(command, "commands", {name: command}).values():
        options = {o for p in shown.params for o in p.opts}
        assert {"--quiet", "-q", "--log-level"} <= options


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_help_shows_an_example(name: str) -> None:
    command = COMMANDS[name]
    for shown in getattr(command, "commands", {name: command}).values():
        assert re.search(rf"`physim-drake .*{shown.name}( |`)", shown.help), shown.name


def test_help_of_the_program_shows_an_example() -> None:
    assert "`physim-drake estimate " in (typer.main.get_command(app).help or "")


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_help_of_an_option_is_a_sentence(name: str) -> None:
    command = COMMANDS[name]
    for shown in getattr(command, "commands", {name: command}).values():
        for option in shown.params:
            said = option.help
            assert said.endswith("."), option.name
            assert len(said.split()) > 2, option.name
            assert not re.match(r"(Of|Or|How|Whose|Where it)\b", said), option.name
