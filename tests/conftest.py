# SPDX-License-Identifier: MIT
"""What the tests of more than one package use."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import settings

# How long an example takes says more about the machine's load than about the code.
settings.register_profile("no-deadline", deadline=None)
settings.load_profile("no-deadline")

_OPTIONAL = {"torch", "playwright"}
"""Modules without which the tests that import them are skipped."""

_SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Skips a file of tests that imports what an extra brings, if it is missing."""
    report = yield
    missing = re.search(r"No module named '(\w+)", str(report.longrepr))
    if report.failed and missing and missing[1] in _OPTIONAL - importable():
        reason = f"Skipped: {missing[1]} is not installed"
        report.outcome, report.longrepr = "skipped", (str(collector.path), 0, reason)
    return report


def importable() -> set[str]:
    """Which of the optional modules are installed."""
    return {name for name in _OPTIONAL if importlib.util.find_spec(name)}


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder beside the repository that holds test data and the evaluator."""
    if not _SHARED.is_dir():
        pytest.skip(f"no test data: {_SHARED} does not exist")
    return _SHARED


@pytest.fixture(scope="session")
def pictures() -> Path:
    """Where tests keep what they saw: ``out/tests``."""
    folder = Path(__file__).resolve().parents[1] / "out" / "tests"
    folder.mkdir(parents=True, exist_ok=True)
    return folder
