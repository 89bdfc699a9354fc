# SPDX-License-Identifier: MIT
from __future__ import annotations

import logging
from collections.abc import Iterator

import pytest

from physim_drake.cli.options import LogLevelName, set_log_level
from physim_drake.parallel.log_levels import LogLevels
from physim_drake.parallel.supervised_pool import SupervisedPool


class Teller:
    """Says a word at each level."""

    def tell(self, name: str) -> None:
        for level in LogLevelName:
            logging.getLogger(name).log(getattr(logging, level.upper()), "at %s", level)


@pytest.fixture(autouse=True)
def loggers() -> Iterator[None]:
    before = LogLevels.current()
    yield
    before.apply()


@pytest.mark.parametrize(
    ("level", "told", "of_drake"),
    [
        (LogLevelName.DEBUG, ["debug", "info", "warning", "error"], None),
        (LogLevelName.INFO, ["info", "warning", "error"], None),
        (LogLevelName.WARNING, ["warning", "error"], ["error"]),
        (LogLevelName.ERROR, ["error"], None),
    ],
)
def test_a_worker_tells_as_much_as_the_command_was_asked_to(
    level: LogLevelName,
    told: list[str],
    of_drake: list[str] | None,
    capfd: pytest.CaptureFixture[str],
) -> None:
    set_log_level(level)
    with SupervisedPool(Teller, 1) as pool:
        pool.map("tell", [("physim_drake.x",), ("drake",)])
    lines = capfd.readouterr().err.splitlines()
    expected = [("physim_drake.x", name) for name in told]
    expected += [("drake", name) for name in of_drake or told]
    assert lines == [f"{name.upper()} {who}: at {name}" for who, name in expected]


def test_where_nothing_was_set_a_worker_has_no_format_either(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    LogLevels({"": logging.WARNING, "physim_drake": 0}, shown=False).apply()
    assert not LogLevels.current().shown
    with SupervisedPool(Teller, 1) as pool:
        pool.map("tell", [("physim_drake.x",)])
    assert capfd.readouterr().err.splitlines() == ["at warning", "at error"]
