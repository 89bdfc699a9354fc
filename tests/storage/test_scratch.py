# SPDX-License-Identifier: MIT
from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from physim_drake.storage.scratch import ScratchFolder

HOLDING = (
    "import sys, time\n"
    "from physim_drake.storage.scratch import ScratchFolder\n"
    "folder = ScratchFolder()\n"
    "(folder.path / 'file').write_text('x')\n"
    "print(folder.path, flush=True)\n"
    "sys.stdin.read()\n"
)


@pytest.fixture(autouse=True)
def temporary_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Temporary files of this process and those it starts go here."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    return tmp_path


def test_it_is_there_until_it_is_closed(temporary_files: Path) -> None:
    with ScratchFolder() as folder:
        assert folder.path.parent == temporary_files
        (folder.path / "file").write_text("x")
    assert list(temporary_files.iterdir()) == []
    folder.close()


def test_what_a_killed_process_left_is_removed_by_the_next(
    temporary_files: Path,
) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDING],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    left = Path(process.stdout.readline().strip())
    with ScratchFolder():
        assert (left / "file").exists()  # its process lives
    process.kill()
    process.communicate()
    assert left.is_dir()
    with ScratchFolder() as folder:
        assert list(temporary_files.iterdir()) == [folder.path]


def test_a_process_that_ends_leaves_nothing(temporary_files: Path) -> None:
    subprocess.run([sys.executable, "-c", HOLDING], input="", check=True, text=True)
    assert list(temporary_files.iterdir()) == []


def test_other_files_stay(temporary_files: Path) -> None:
    other = temporary_files / "physim-drake-file"
    other.write_text("")
    (temporary_files / "physim-drake-link").symlink_to(temporary_files / "mine")
    (temporary_files / "mine").mkdir()
    with ScratchFolder():
        pass
    assert len(list(temporary_files.iterdir())) == 3
