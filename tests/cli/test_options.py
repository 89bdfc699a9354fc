# SPDX-License-Identifier: MIT
"""What holds for the options of all commands."""

from __future__ import annotations

import json
import logging
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from physim_drake.cli import app
from physim_drake.cli.options import LogLevelName, messages, set_log_level, write_json
from physim_drake.errors import InputError

COMMANDS: dict[str, Any] = typer.main.get_command(app).commands  # type: ignore[attr-defined]
LONG = sorted(set(COMMANDS) - {"doctor"})


@pytest.fixture
def loggers() -> Iterator[None]:
    names = ("", "drake")
    before = [logging.getLogger(name).level for name in names]
    yield
    for name, level in zip(names, before, strict=True):
        logging.getLogger(name).setLevel(level)


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


@pytest.mark.usefixtures("loggers")
def test_log_levels_are_those_of_all_loggers_but_known_warnings_of_drake() -> None:
    set_log_level(LogLevelName.DEBUG)
    assert logging.getLogger("physim_drake.x").isEnabledFor(logging.DEBUG)
    assert logging.getLogger("drake").isEnabledFor(logging.DEBUG)
    set_log_level(LogLevelName.WARNING)
    assert not logging.getLogger("physim_drake.x").isEnabledFor(logging.INFO)
    assert logging.getLogger("physim_drake.x").isEnabledFor(logging.WARNING)
    assert not logging.getLogger("drake").isEnabledFor(logging.WARNING)
    set_log_level(LogLevelName.ERROR)
    assert not logging.getLogger("physim_drake.x").isEnabledFor(logging.WARNING)


def test_messages_go_to_stderr_unless_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    messages(quiet=True).print("unheard")
    messages(quiet=False).print("heard")
    assert capsys.readouterr() == ("", "heard\n")


def test_json_goes_to_a_file_or_to_stdout(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not write_json(tmp_path / "x.json", {"a": 1})
    assert json.loads((tmp_path / "x.json").read_text()) == {"a": 1}
    assert capsys.readouterr().out == ""
    assert write_json(Path("-"), {"a": 1})
    assert json.loads(capsys.readouterr().out) == {"a": 1}
    with pytest.raises(InputError, match="cannot be written"):
        write_json(tmp_path / "no" / "x.json", {})


def test_the_first_import_of_drake_does_not_raise_its_voice() -> None:
    code = (
        "import logging\n"
        "from physim_drake.cli.options import LogLevelName, set_log_level\n"
        "set_log_level(LogLevelName.WARNING)\n"
        "import pydrake.multibody.plant\n"
        "print(logging.getLogger('drake').level)\n"
    )
    command = [sys.executable, "-c", code]
    printed = subprocess.run(command, capture_output=True, text=True, check=True)
    assert int(printed.stdout) == logging.ERROR
