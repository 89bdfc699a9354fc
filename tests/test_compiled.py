# SPDX-License-Identifier: MIT
from __future__ import annotations

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

MODULE = """
from physim_drake.compiled import compiled

@compiled(error_model="numpy")
def half(x):
    return x / 2
"""


@pytest.fixture
def module(tmp_path: Path) -> Path:
    path = tmp_path / "halves.py"
    path.write_text(MODULE)
    return path


def halve(module: Path, before: str = "") -> list[str]:
    """Calls it in a process of its own; what is said of the cache."""
    code = f"""{before}
import halves
assert halves.half(3.0) == 1.5
stats = halves.half.stats
print(stats.cache_path, len(stats.cache_hits), len(stats.cache_misses))
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=module.parent,
        env={k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.split()


def test_what_was_compiled_is_kept(module: Path) -> None:
    folder = str(module.parent / "__pycache__")
    assert halve(module) == [folder, "0", "1"]
    assert halve(module) == [folder, "1", "0"]


def test_a_full_disk_costs_only_time(module: Path) -> None:
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    full = (
        "import resource, physim_drake.compiled\n"
        f"resource.setrlimit(resource.RLIMIT_FSIZE, (100, {hard}))"
    )
    for _ in range(2):
        assert halve(module, full)[1:] == ["0", "1"]
    assert list((module.parent / "__pycache__").glob("*.nb*")) == []


def test_without_a_place_it_is_compiled_each_time(module: Path) -> None:
    (module.parent / "__pycache__").write_text("no folder")
    nowhere = (
        "import os\n"
        f"os.environ.update(HOME={str(module)!r}, XDG_CACHE_HOME={str(module)!r})"
    )
    for _ in range(2):
        assert halve(module, nowhere) == ["None", "0", "1"]
