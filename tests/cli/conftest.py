# SPDX-License-Identifier: MIT
"""What the tests of `physim-drake estimate` have in common."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.estimating import Run, estimate_command, two_images


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    return estimate_command(monkeypatch)


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    return two_images(tmp_path / "two")
