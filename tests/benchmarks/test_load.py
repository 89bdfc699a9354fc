# SPDX-License-Identifier: MIT
from __future__ import annotations

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
from load import Sample, _proportional_mb, fill_library, repeat_example, summarise

from physim_drake.datasets.bop import BopDataset
from physim_drake.datasets.detections import load_detections
from physim_drake.objects.library_files import find_objects


def test_the_repeated_example_is_a_dataset(tmp_path: Path) -> None:
    repeat_example(tmp_path, 3)
    dataset = BopDataset(tmp_path)
    assert dataset.images() == [(1, 0), (1, 1), (1, 2)]
    first, last = (dataset.observation(1, k).depth for k in (0, 2))
    assert (first == last).all()
    found = load_detections(tmp_path / "detections.json", dataset)
    wanted = sorted(t.object_id for t in dataset.targets() if t.im_id == 2)
    assert sorted(d.object_id for d in found[1, 2]) == wanted


def test_a_library_is_filled_up(tmp_path: Path) -> None:
    entries = find_objects(fill_library(tmp_path / "models", 30))
    assert len(entries) == 30
    assert all(entry.mesh.is_file() for entry in entries)


def test_growth_is_told_from_none() -> None:
    def samples(slope: float) -> list[Sample]:
        return [Sample(k, k, 500.0, 1000.0 + slope * k) for k in range(200)]

    assert summarise(samples(0.0), 200)["flat"] is True
    assert summarise(samples(1.0), 200)["flat"] is False
    assert summarise(samples(1.0)[:10], 10)["flat"] is None


def test_the_memory_of_a_process_is_read() -> None:
    assert 5 < _proportional_mb(os.getpid()) < 20_000
    assert _proportional_mb(0) == 0.0
