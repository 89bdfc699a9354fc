# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from physim_drake.datasets.bop import BopDataset
from physim_drake.errors import InputError
from physim_drake.systems.replay_source import ReplaySource, ReplaySourceConfig
from physim_drake.systems.stage import TimingConfig
from tests.systems.looks import build, shown

TABLETOP = Path(__file__).parents[2] / "examples" / "data" / "tabletop"
CONFIG = ReplaySourceConfig(TABLETOP)


def replay(config: ReplaySourceConfig, end: float) -> tuple[Any, Any]:
    """The observation and detections shown after so many seconds, a look a second."""
    source = ReplaySource(config, period=1.0, timing=TimingConfig(poll_period=0.1))
    simulator = Simulator(build(source))
    simulator.AdvanceTo(end)
    context = simulator.get_context()
    return tuple(shown(source, context, p) for p in ("observation", "detections"))


def test_images_come_with_their_detections() -> None:
    observation, detections = replay(CONFIG, 0.5)
    expected = BopDataset(TABLETOP).observation(1, 0)
    np.testing.assert_array_equal(observation.value.depth, expected.depth)
    assert [d.object_id for d in detections.value] == [8, 1, 5]
    assert (observation.number, detections.number) == (1, 1)


def test_after_the_last_image_there_are_no_more_looks() -> None:
    assert replay(CONFIG, 3.5)[0].number == 1


def test_a_replay_may_begin_again() -> None:
    observation, _ = replay(replace(CONFIG, repeat=True), 3.5)
    assert (observation.number, observation.time) == (4, 3.0)


def test_masks_may_stand_for_detections() -> None:
    _, detections = replay(replace(CONFIG, masks=True), 0.5)
    assert all(d.mask is not None for d in detections.value)


def test_targets_without_a_detection_are_not_seen(tmp_path: Path) -> None:
    one = json.loads((TABLETOP / "detections.json").read_text())[:1]
    path = tmp_path / "one.json"
    path.write_text(json.dumps(one))
    _, detections = replay(replace(CONFIG, detections=path), 0.5)
    assert sorted(d.seen for d in detections.value) == [False, False, True]


def test_an_image_that_cannot_be_used_is_a_look_with_an_error(tmp_path: Path) -> None:
    root = tmp_path / "tabletop"
    shutil.copytree(TABLETOP, root)
    depth = root / "test" / "000001" / "depth" / "000000.png"
    depth.write_bytes(depth.read_bytes()[:-400])
    observation, detections = replay(replace(CONFIG, dataset=root, masks=True), 0.5)
    assert observation.value is None
    assert "is a PNG cut short" in detections.error


def test_a_dataset_or_image_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match='has no folder "test"'):
        ReplaySource(ReplaySourceConfig(tmp_path))
    with pytest.raises(InputError, match="7/0 has no target"):
        ReplaySource(replace(CONFIG, images=("7/0",)))


def test_masks_and_a_file_of_detections_exclude_each_other() -> None:
    with pytest.raises(InputError, match="detections: is given together with masks"):
        replace(CONFIG, masks=True, detections=TABLETOP / "detections.json")
