# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from collections.abc import Iterator

import pytest
from typer.testing import CliRunner

from physim_drake.cli import app
from physim_drake.doctor import checks as installation
from physim_drake.doctor.checks import Check, Status

OK = Check("memory", Status.OK, "8.0 GiB available")
WARNING = Check("cores", Status.WARNING, "1", "use more")
FAIL = Check("rendering", Status.FAIL, "ended by SIGSEGV", "apt-get install libegl1")


def found(monkeypatch: pytest.MonkeyPatch, *checks: Check) -> None:
    def give() -> Iterator[Check]:
        yield from checks

    monkeypatch.setattr(installation, "check_installation", give)


def test_a_line_a_check_and_the_remedy_below(monkeypatch: pytest.MonkeyPatch) -> None:
    found(monkeypatch, OK, WARNING, FAIL)
    result = CliRunner().invoke(app, ["doctor"])
    assert result.exit_code == 1
    assert result.stdout.splitlines() == [
        "ok       memory: 8.0 GiB available",
        "warning  cores: 1",
        "         -> use more",
        "FAIL     rendering: ended by SIGSEGV",
        "         -> apt-get install libegl1",
        "1 of 3 checks failed",
    ]


def test_a_warning_is_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    found(monkeypatch, OK, WARNING)
    result = CliRunner().invoke(app, ["doctor"])
    assert result.exit_code == 0
    assert result.stdout.splitlines()[-1] == "everything needed works"


@pytest.mark.parametrize(("last", "code"), [(WARNING, 0), (FAIL, 1)])
def test_json_is_all_that_is_printed(
    monkeypatch: pytest.MonkeyPatch, last: Check, code: int
) -> None:
    found(monkeypatch, OK, last)
    result = CliRunner().invoke(app, ["doctor", "--json"])
    assert result.exit_code == code
    report = json.loads(result.stdout)
    assert report == {"ok": code == 0, "checks": [OK.as_dict(), last.as_dict()]}
    assert report["checks"][1]["status"] == str(last.status)


def test_bad_usage_is_2() -> None:
    assert CliRunner().invoke(app, ["doctor", "--no-such-option"]).exit_code == 2
