# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save

from benchmarks.kill_cases import NAMES, contents, few_models, make_cases
from physim_drake.objects.library_files import find_objects


def same(write: Callable[[Path, int], object], folder: Path) -> bool:
    """Whether what is written for 0 counts as the same as what is written for 1."""
    for k in (0, 1):
        (folder / str(k)).mkdir()
        write(folder / str(k), k)
    return contents(folder / "0") == contents(folder / "1")


def results(folder: Path, k: int) -> None:
    (folder / "results.csv").write_text(f"scene_id,score,time\n1,0.5,{k}.0\n")


def training(folder: Path, k: int) -> None:
    log = {"losses": [{"step": 1, "box": 0.25, "seconds": k}]}
    (folder / "training.json").write_text(json.dumps(log))


def picked(folder: Path, k: int) -> None:
    times = {"wall_time": k, "real_time_factor": 1.0, "stages": {"look": k}}
    figures = times | {"episodes": [times | {"cleared": 1}]}
    (folder / "pick.json").write_text(json.dumps(figures))
    (folder / "picked").mkdir()
    (folder / "picked" / "index.html").write_text(f"real-time factor {k}")


def progress(folder: Path, k: int) -> None:
    (folder / "results.csv.progress").write_text(str(k))


def weights(folder: Path, k: int) -> None:
    metadata = {"version": "1", "network": "{}", "classes": "[]"}
    data = save({"a": np.zeros(2), "b": np.ones(3)}, metadata)
    end = 8 + int.from_bytes(data[:8], "little")
    entries = sorted(json.loads(data[8:end]).items(), reverse=bool(k))
    header = json.dumps(dict(entries)).encode()
    size = len(header).to_bytes(8, "little")
    (folder / "w.safetensors").write_bytes(size + header + data[end:])


@pytest.mark.parametrize("write", [results, training, picked, progress, weights])
def test_times_and_the_order_of_a_header_make_no_difference(
    write: Callable[[Path, int], object], tmp_path: Path
) -> None:
    assert same(write, tmp_path)


def scored(folder: Path, k: int) -> None:
    (folder / "results.csv").write_text(f"scene_id,score,time\n1,0.{k},1.0\n")


def learnt(folder: Path, k: int) -> None:
    data = save({"a": np.full(2, float(k))}, {"version": "1"})
    (folder / "w.safetensors").write_bytes(data)


def cleared(folder: Path, k: int) -> None:
    times = {"wall_time": 1, "real_time_factor": 1.0, "stages": {}}
    figures = times | {"episodes": [times | {"cleared": k}]}
    (folder / "pick.json").write_text(json.dumps(figures))


def reported(folder: Path, k: int) -> None:
    (folder / "report").mkdir()
    (folder / "report" / "index.html").write_text(f"{k} objects")


def added(folder: Path, k: int) -> None:
    if k:
        (folder / "picked").mkdir()
        (folder / "picked" / "index.html").write_text("")


@pytest.mark.parametrize("write", [scored, learnt, cleared, reported, added])
def test_results_make_a_difference(
    write: Callable[[Path, int], object], tmp_path: Path
) -> None:
    assert not same(write, tmp_path)


def test_commands_write_below_the_folder_that_they_are_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchmarks.kill_cases.run", lambda command, folder: None)
    cases = make_cases(tmp_path / "new", NAMES)
    assert tuple(case.name for case in cases) == NAMES
    for case in cases:
        command = case.command(tmp_path / "here", 3)
        assert command[-2:] == ["--workers", "3"]
        assert any(str(tmp_path / "here") in word for word in command)


def test_a_library_of_few_models(tmp_path: Path) -> None:
    entries = find_objects(few_models(tmp_path / "few", 2))
    assert len(entries) == 2
    assert all(entry.mesh.is_file() for entry in entries)
