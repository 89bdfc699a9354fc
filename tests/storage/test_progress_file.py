# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path

import pytest

from physim_drake.errors import InputError
from physim_drake.storage.progress_file import ProgressFile

NOTES = [{"done": 1}, {"done": 2}, {"done": 3}]


def run(
    path: Path, *, resume: bool = True, seed: str = "1", until: int = 3
) -> list[int]:
    """Does what is not noted yet and returns what was."""
    with ProgressFile(path, {"seed": seed}, Path("results")) as progress:
        earlier = [note["done"].integer() for note in progress.go_on(resume)]
        for note in NOTES[len(earlier) : until]:
            progress.add(note)
    return earlier


def test_goes_on_where_it_was_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "a.progress"
    assert run(path, until=2) == []
    assert run(path) == [1, 2]
    assert run(path) == [1, 2, 3]
    assert run(path, resume=False) == []


def test_cut_at_any_byte_the_whole_notes_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.progress"
    run(path)
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        assert run(path) == [1, 2, 3][: max(whole[:length].count(b"\n") - 1, 0)]
        assert path.read_bytes() == whole


def test_other_settings_cannot_go_on(tmp_path: Path) -> None:
    path = tmp_path / "a.progress"
    run(path)
    before = path.read_bytes()
    with pytest.raises(InputError) as caught:
        run(path, seed="2")
    assert str(caught.value) == (
        f"{path}: seed: the run began with '1', this one has '2'; use the same, or run "
        "without --resume to begin again"
    )
    assert path.read_bytes() == before


def test_a_damaged_line_is_said(tmp_path: Path) -> None:
    path = tmp_path / "a.progress"
    run(path)
    path.write_bytes(path.read_bytes().replace(b'{"done": 2}', b'{"done" 2}'))
    with pytest.raises(InputError, match="line 3: is not valid JSON"):
        run(path)


def test_two_runs_do_not_write_the_same_file(tmp_path: Path) -> None:
    path = tmp_path / "a.progress"
    with (
        ProgressFile(path, {}, tmp_path / "results"),
        pytest.raises(InputError, match="results: is being written by another run"),
    ):
        ProgressFile(path, {}, tmp_path / "results")
    assert run(path) == []


def test_a_file_that_vanishes_is_said(tmp_path: Path) -> None:
    path = tmp_path / "a.progress"
    with ProgressFile(path, {}, path) as progress:
        progress.begin()
        progress.check_in_place()
        path.unlink()
        with pytest.raises(InputError, match="was removed or replaced"):
            progress.check_in_place()


def test_unwritable_places(tmp_path: Path) -> None:
    for path in (tmp_path / "none" / "a.progress", tmp_path):
        with pytest.raises(InputError, match="cannot be written"):
            ProgressFile(path, {}, path)
