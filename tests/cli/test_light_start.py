# SPDX-License-Identifier: MIT
"""What must answer at once imports nothing heavy."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ("cv2", "numba", "numpy", "pydrake", "scipy", "torch", "trimesh")
RUN = """
import contextlib, sys, physim_drake.cli
sys.argv = ["physim-drake", *{arguments!r}]
with contextlib.suppress(SystemExit):
    physim_drake.cli.main()
"""


def heavy_imports(code: str) -> set[str]:
    """The heavy packages that are imported after some code has run."""
    tell = f"import sys\nprint('HEAVY', *set({HEAVY!r}) & sys.modules.keys())"
    command = [sys.executable, "-c", f"{code}\n{tell}"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split()[1:])


@pytest.mark.parametrize(
    "arguments",
    [["--version"], ["--help"], ["estimate", "--help"], ["train", "--help"]],
)
def test_version_and_help_answer_at_once(arguments: list[str]) -> None:
    assert heavy_imports(RUN.format(arguments=arguments)) == set()


def test_a_heavy_import_is_seen() -> None:
    assert heavy_imports("import numpy") == {"numpy"}
