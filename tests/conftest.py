# SPDX-License-Identifier: MIT
"""What the tests of more than one package use."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import settings

# How long an example takes says more about the machine's load than about the code.
settings.register_profile("no-deadline", deadline=None)
settings.load_profile("no-deadline")

_SHARED = Path(__file__).resolve().parents[2] / "shared"


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
