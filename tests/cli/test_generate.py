# SPDX-License-Identifier: MIT
from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from physim_drake.models import APC11

PROGRAM = [sys.executable, "-c", "from physim_drake.cli import main; main()"]


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*PROGRAM, "generate", *map(str, arguments)], capture_output=True, text=True
    )


def check_refused(result: subprocess.CompletedProcess[str], text: str) -> None:
    assert result.returncode == 2
    lines = result.stderr.strip().splitlines()
    assert [line for line in lines if line.startswith("error: ")] == lines[-1:]
    assert text in lines[-1]
    assert "Traceback" not in result.stderr


def test_makes_a_dataset(tmp_path: Path):
    out = tmp_path / "out"
    result = run(
        out, "--scenes", 2, "--levels", "1", "--objects", "1:1", "--views", 1,
        "--workers", 2, "--camera", "d435", "--no-noise",
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert "2 images of 2 scenes" in result.stdout
    assert sorted(p.name for p in (out / "test").iterdir()) == ["000001", "000002"]
    assert "610.3" in (out / "test/000001/scene_camera.json").read_text()


def test_impossible_level(tmp_path: Path):
    result = run(tmp_path / "out", "--levels", "1,3", "--objects", "2:2")
    check_refused(result, "3 needs 3 objects")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("option", "value"),
    [("--levels", "0"), ("--levels", ""), ("--objects", "3"), ("--objects", "4:2")],
)
def test_bad_options(tmp_path: Path, option: str, value: str):
    check_refused(
        run(tmp_path / "out", option, value), "objects" if ":" in value else option
    )


def test_unreadable_mesh(tmp_path: Path):
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "broken.obj").write_text("v 0 0\nf 1 2 3\n")
    result = run(tmp_path / "out", "--models", tmp_path / "models")
    check_refused(result, "broken.obj")
    assert not (tmp_path / "out").exists()


def test_unwritable_folder(tmp_path: Path):
    (tmp_path / "file").write_text("")
    check_refused(run(tmp_path / "file" / "out"), "cannot be written")


def test_disk_that_is_full(tmp_path: Path):
    """A limit on the size of files acts like a full disk, from the first model on."""
    script = f"ulimit -f 20; exec {sys.executable} -c '{PROGRAM[2]}' generate out"
    result = subprocess.run(
        ["bash", "-c", f"{script} --models {APC11}"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    check_refused(result, "cannot be written")
    assert not (tmp_path / "out" / "models").exists()
    assert '"complete": false' in (tmp_path / "out" / "generation.json").read_text()
