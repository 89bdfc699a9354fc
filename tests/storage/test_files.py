# SPDX-License-Identifier: MIT
from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from physim_drake.errors import InputError
from physim_drake.storage.files import (
    check_writable,
    fill_folder,
    reading,
    write_atomically,
)
from tests.disks import room_for


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_writes_text_and_bytes(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with write_atomically(path) as text:
        text.write("é\n")
    assert path.read_bytes() == "é\n".encode()
    with write_atomically(path, "wb") as binary:
        binary.write(b"\0")
    assert path.read_bytes() == b"\0"
    assert names(tmp_path) == ["a.txt"]


def test_a_failure_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), write_atomically(path) as file:
        file.write("new" * (1 // 0))
    assert path.read_text() == "old"
    assert names(tmp_path) == ["a.txt"]


def test_unwritable_places_name_the_path(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "none" / "a", tmp_path / "file" / "a", tmp_path):
        with (
            pytest.raises(InputError, match="cannot be written") as caught,
            write_atomically(path) as file,
        ):
            file.write("x")
        assert caught.value.source == str(path)


def test_errors_of_other_files_pass(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), write_atomically(tmp_path / "a") as file:
        file.write((tmp_path / "other").read_text())
    assert names(tmp_path) == []


def test_what_a_killed_writer_left_is_removed_by_the_next(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    code = (
        "import os, pathlib, sys\n"
        "from physim_drake.storage.files import write_atomically\n"
        "with write_atomically(pathlib.Path(sys.argv[1])) as file:\n"
        "    file.write('half')\n"
        "    file.flush()\n"
        "    os.kill(os.getpid(), 9)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)])
    assert done.returncode == -9
    (left,) = names(tmp_path)
    assert left.startswith(".a.txt.")
    (tmp_path / ".a.txt.notes.tmp").write_text("of someone else")
    with write_atomically(path) as file:
        file.write("whole")
    assert names(tmp_path) == [".a.txt.notes.tmp", "a.txt"]


def test_two_writers_leave_each_other_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with write_atomically(path) as first:
        with write_atomically(path) as second:
            second.write("second")
        assert path.read_text() == "second"
        first.write("first")
    assert path.read_text() == "first"
    assert names(tmp_path) == ["a.txt"]


def test_symbolic_links_are_followed(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "real")
    with write_atomically(tmp_path / "link") as file:
        file.write("x")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "x"


def test_devices_are_written_straight() -> None:
    with write_atomically(Path(os.devnull)) as file:
        file.write("x")
    assert not Path(os.devnull).is_file()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_full_disk_is_an_input_error() -> None:
    with (
        pytest.raises(InputError, match="No space left"),
        write_atomically(Path("/dev/full")) as file,
    ):
        file.write("x")


def test_a_full_disk_asks_for_room(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with (
        pytest.raises(InputError, match="free some space there, or choose another"),
        room_for(10),
        write_atomically(path) as file,
    ):
        file.write("longer than that")
    assert path.read_text() == "old"
    assert names(tmp_path) == ["a.txt"]


def test_places_to_write_are_checked_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    check_writable(tmp_path / "new")
    check_writable(Path("/dev/stdout"))
    assert names(tmp_path) == ["file"]
    for path in (tmp_path / "none" / "a", tmp_path / "file" / "a"):
        with pytest.raises(InputError, match="cannot be written") as caught:
            check_writable(path)
        assert caught.value.source == str(path)


def test_a_folder_comes_whole(tmp_path: Path) -> None:
    folder = tmp_path / "a"
    with fill_folder(folder) as scratch:
        (scratch / "one").write_text("1")
        assert not folder.exists()
    assert names(folder) == ["one"]
    assert names(tmp_path) == ["a"]


def test_a_folder_that_cannot_be_filled_leaves_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "a"

    def fill() -> None:
        with fill_folder(folder) as scratch:
            (scratch / "one").write_text("1")
            (scratch / "two").write_text("longer than that")

    with pytest.raises(InputError, match="cannot be written") as caught, room_for(10):
        fill()
    assert caught.value.source == str(folder)
    with pytest.raises(FileNotFoundError), fill_folder(folder) as scratch:
        (scratch / "one").write_text((tmp_path / "other").read_text())
    assert names(tmp_path) == []


def test_a_folder_that_is_there_is_kept(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "mine").write_text("")
    with (
        pytest.raises(InputError, match="cannot be written"),
        fill_folder(tmp_path / "a") as scratch,
    ):
        (scratch / "one").write_text("1")
    assert names(tmp_path / "a") == ["mine"]
    assert names(tmp_path) == ["a"]


def test_the_file_that_a_library_missed_is_named(tmp_path: Path) -> None:
    there, lost = tmp_path / "there", tmp_path / "lost"
    there.write_text("")
    with (
        pytest.raises(InputError, match="was removed during the run") as caught,
        reading([there, lost]),
    ):
        raise RuntimeError("no such model")
    assert caught.value.source == str(lost)
    with pytest.raises(RuntimeError, match="something else"), reading([there]):
        raise RuntimeError("something else")
