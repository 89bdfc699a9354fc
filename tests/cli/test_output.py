# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
import logging
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from physim_drake.cli.output import (
    LogLevelName,
    counted,
    messages,
    output_json,
    set_log_level,
)
from physim_drake.errors import InputError


@pytest.fixture
def loggers() -> Iterator[None]:
    names = ("", "drake")
    before = [logging.getLogger(name).level for name in names]
    yield
    for name, level in zip(names, before, strict=True):
        logging.getLogger(name).setLevel(level)


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
    assert not output_json(tmp_path / "x.json", {"a": 1})
    assert json.loads((tmp_path / "x.json").read_text()) == {"a": 1}
    assert capsys.readouterr().out == ""
    assert output_json(Path("-"), {"a": 1})
    assert json.loads(capsys.readouterr().out) == {"a": 1}
    with pytest.raises(InputError, match="cannot be written"):
        output_json(tmp_path / "no" / "x.json", {})


def test_the_first_import_of_drake_does_not_raise_its_voice() -> None:
    code = (
        "import logging\n"
        "from physim_drake.cli.output import LogLevelName, set_log_level\n"
        "set_log_level(LogLevelName.WARNING)\n"
        "import pydrake.multibody.plant\n"
        "print(logging.getLogger('drake').level)\n"
    )
    command = [sys.executable, "-c", code]
    printed = subprocess.run(command, capture_output=True, text=True, check=True)
    assert int(printed.stdout) == logging.ERROR


def test_one_thing_has_no_plural() -> None:
    assert [counted(n, "image") for n in (0, 1, 2)] == [
        "0 images",
        "1 image",
        "2 images",
    ]
