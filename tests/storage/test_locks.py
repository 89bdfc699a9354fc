# SPDX-License-Identifier: MIT
from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from physim_drake.storage.locks import hold, remove_abandoned


def test_what_one_holds_another_does_not_get(tmp_path: Path) -> None:
    path = tmp_path / "file"
    with path.open("w") as one, path.open() as other:
        assert hold(one.fileno(), without_locks=False)
        assert not hold(other.fileno(), without_locks=True)
    with path.open() as other:
        assert hold(other.fileno(), without_locks=False)


@pytest.mark.parametrize("answer", [False, True])
def test_a_file_system_without_locks_has_an_answer_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: bool
) -> None:
    def flock(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", flock)
    with (tmp_path / "file").open("w") as file:
        assert hold(file.fileno(), without_locks=answer) is answer


def test_only_what_nobody_holds_is_removed(tmp_path: Path) -> None:
    held, left, gone = (tmp_path / name for name in ("held", "left", "gone"))
    left.touch()
    with held.open("w") as file:
        hold(file.fileno(), without_locks=False)
        remove_abandoned([gone, held, left], Path.unlink)
    assert list(tmp_path.iterdir()) == [held]


def test_a_pipe_of_somebody_else_does_not_stop_it(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    remove_abandoned([tmp_path / "pipe"], Path.unlink)
