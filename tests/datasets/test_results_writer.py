# SPDX-License-Identifier: MIT
from __future__ import annotations

import resource
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from physim_drake.datasets.results import COLUMNS, ResultRow, read_results
from physim_drake.datasets.results_writer import ResultsWriter
from physim_drake.errors import InputError, PhysimError
from tests.datasets.tiny import mangled

IMAGES = {0: 2, 1: 0, 2: 1}
"""Found objects of each image of scene 1."""


def rows(im_id: int) -> list[ResultRow]:
    return [ResultRow(1, im_id, n, 1.0, np.eye(4)) for n in range(IMAGES[im_id])]


def run(path: Path, *, resume: bool = False, until: int = 3) -> list[int]:
    """Writes the images that are not done and returns them."""
    with ResultsWriter(path, resume, {"seed": "1"}) as writer:
        todo = [im_id for im_id in range(until) if (1, im_id) not in writer.done]
        for im_id in todo:
            writer.write_image(1, im_id, rows(im_id), time=0.5)
    return todo


def test_writes_what_is_read(tmp_path: Path) -> None:
    path = tmp_path / "results.csv"
    run(path)
    assert path.read_text().splitlines()[0] == ",".join(COLUMNS)
    assert [(r.im_id, r.object_id, r.time) for r in read_results(path)] == [
        (0, 0, 0.5),
        (0, 1, 0.5),
        (2, 0, 0.5),
    ]


def test_resuming_skips_what_is_done_even_when_nothing_was_found(
    tmp_path: Path,
) -> None:
    path = tmp_path / "results.csv"
    run(path, until=2)
    assert run(path, resume=True) == [2]
    assert run(path, resume=True) == []
    assert run(path) == [0, 1, 2]


def test_resuming_nothing_begins(tmp_path: Path) -> None:
    assert run(tmp_path / "results.csv", resume=True) == [0, 1, 2]


@pytest.mark.parametrize("lost", ["results", "progress"])
def test_a_run_cut_at_any_byte_ends_the_same(tmp_path: Path, lost: str) -> None:
    whole, path = tmp_path / "whole.csv", tmp_path / "cut.csv"
    progress = tmp_path / "cut.csv.progress"
    run(whole)
    expected = whole.read_bytes()
    log = (tmp_path / "whole.csv.progress").read_bytes()
    lengths = [len(line) for line in log.splitlines(keepends=True)]
    if lost == "progress":
        # The progress line was torn; the results may hold more than it says.
        for length in range(len(log) + 1):
            path.write_bytes(expected)
            progress.write_bytes(log[:length])
            run(path, resume=True)
            assert path.read_bytes() == expected
    else:
        # The last image's rows were torn, and its progress line never written.
        block = expected.rindex(b"\n", 0, -1) + 1
        for length in range(block, len(expected)):
            path.write_bytes(expected[:length])
            progress.write_bytes(log[: -lengths[-1]])
            assert run(path, resume=True) == [2]
            assert path.read_bytes() == expected


def test_other_settings_cannot_resume(tmp_path: Path) -> None:
    path = tmp_path / "results.csv"
    run(path)
    with pytest.raises(InputError, match="seed: the run began with '1', this one"):
        ResultsWriter(path, True, {"seed": "2"})


def test_what_cannot_be_resumed(tmp_path: Path) -> None:
    path = tmp_path / "results.csv"
    path.write_text("mine\n")
    with pytest.raises(InputError, match="not known which results are complete"):
        ResultsWriter(path, resume=True)
    assert path.read_text() == "mine\n"
    run(path)
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(InputError, match="it was changed"):
        run(path, resume=True)


def test_a_second_writer_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "results.csv"
    with ResultsWriter(path) as writer:
        writer.write_image(1, 0, rows(0))
        with pytest.raises(InputError, match="another run"):
            ResultsWriter(path)
    assert len(read_results(path)) == 2


def test_unwritable_places(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        ResultsWriter(tmp_path / "none" / "results.csv")
    with pytest.raises(InputError, match="cannot be written"):
        ResultsWriter(tmp_path)


def test_a_full_disk_is_an_input_error(tmp_path: Path) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    path = tmp_path / "results.csv"
    path.symlink_to("/dev/full")
    with pytest.raises(InputError, match="cannot be written"):
        run(path)


def test_mistakes_of_the_caller(tmp_path: Path) -> None:
    with ResultsWriter(tmp_path / "results.csv") as writer:
        writer.write_image(1, 0, rows(0))
        with pytest.raises(ValueError, match="already been written"):
            writer.write_image(1, 0, rows(0))
        with pytest.raises(ValueError, match="row of another image"):
            writer.write_image(1, 2, rows(0))
        with pytest.raises(ValueError, match="not a rigid transform"):
            writer.write_image(1, 2, [ResultRow(1, 2, 3, 1.0, np.full((4, 4), np.nan))])


@settings(
    max_examples=100,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_mangled_progress_raises_only_input_errors(
    tmp_path: Path, data: st.DataObject
) -> None:
    path, progress = tmp_path / "results.csv", tmp_path / "results.csv.progress"
    run(path)
    progress.write_bytes(data.draw(mangled(progress.read_bytes())))
    with suppress(PhysimError):
        run(path, resume=True)


@pytest.mark.parametrize("name", ["results.csv", "results.csv.progress"])
def test_a_file_that_vanishes_during_the_run_is_said(tmp_path: Path, name: str) -> None:
    with ResultsWriter(tmp_path / "results.csv") as writer:
        writer.write_image(1, 0, rows(0), time=0.5)
        (tmp_path / name).unlink()
        with pytest.raises(InputError, match="was removed or replaced") as caught:
            writer.write_image(1, 1, rows(1), time=0.5)
        assert caught.value.source == str(tmp_path / name)


@pytest.mark.parametrize("room", [0, 10, 60])
def test_a_full_disk_leaves_whole_images(tmp_path: Path, room: int) -> None:
    """A limit on the size of files acts like one."""
    path = tmp_path / "results.csv"
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with ResultsWriter(path, settings={"seed": "1"}) as writer:
        writer.write_image(1, 2, rows(2), time=0.5)
        whole = path.read_bytes()
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(whole) + room, hard))
        try:
            with pytest.raises(InputError, match=r"results\.csv: cannot be written"):
                writer.write_image(1, 0, rows(0), time=0.5)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_bytes() == whole
    assert run(path, resume=True) == [0, 1]
    assert len(read_results(path)) == 3
