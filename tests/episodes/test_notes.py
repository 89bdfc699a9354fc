# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physim_drake.episodes.notes import EpisodeNotes, scenario_settings
from physim_drake.episodes.result import summary
from physim_drake.errors import InputError
from physim_drake.picking.scenario import PickScenario, load_scenario
from physim_drake.storage.progress_file import ProgressFile
from tests.episodes.test_result import result

CELL = """
directives:
- add_directives: {file: "package://physim_drake_models/pick_cell/pick_cell.dmd.yaml"}
- add_frame:
    name: elsewhere
    X_PF: {base_frame: world, translation: [0.0, 0.0, 1.0], rotation: !Rpy {deg: [1.0, 2.0, 3.0]}}
"""  # noqa: E501


def test_episodes_come_back_to_the_last_digit(tmp_path: Path) -> None:
    path = tmp_path / "pick.progress"
    first, second = result(simulated=1 / 3), result(episode=1)
    with ProgressFile(path, {}, path) as progress:
        notes = EpisodeNotes(progress, progress.go_on(True))
        told = [notes.add(first), notes.add(second)]
    with ProgressFile(path, {}, path) as progress:
        earlier = EpisodeNotes(progress, progress.go_on(True)).results
    assert list(earlier) == [0, 1]
    assert list(earlier.values()) == told == [first, second]
    assert json.dumps(summary(told)) == json.dumps(summary([first, second]))


def test_what_is_told_does_not_depend_on_a_file(tmp_path: Path) -> None:
    """Where an episode holds a whole number, a file gives it back as a fraction."""
    whole = result(simulated=12, stages={"simulation": np.float64(3)})
    with ProgressFile(tmp_path / "a", {}, tmp_path) as progress:
        progress.begin()
        kept = EpisodeNotes(progress).add(whole)
    assert repr(kept) == repr(EpisodeNotes().add(whole))
    assert repr(kept.simulated) == "12.0"


def test_a_file_of_something_else_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with ProgressFile(path, {}, path) as progress:
        progress.begin()
        progress.add({"episode": 1})
    with ProgressFile(path, {}, path) as progress:
        notes = progress.go_on(True)
        with pytest.raises(InputError, match='line 2: has no "objects"'):
            EpisodeNotes(progress, notes)


def test_settings_are_text_that_says_all_that_matters(tmp_path: Path) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(CELL, encoding="utf-8")
    settings = scenario_settings(load_scenario(path))
    assert settings == scenario_settings(load_scenario(path))
    assert settings["look.detector"] == "network"
    assert "elsewhere" in settings["directives"]
    assert " at 0x" not in "".join(settings.values())
    for old, new in (("1.0, 2.0, 3.0", "1.0, 2.0, 4.0"), ("0.0, 1.0]", "0.0, 2.0]")):
        path.write_text(CELL.replace(old, new), encoding="utf-8")
        other = scenario_settings(load_scenario(path))
        assert [n for n in settings if settings[n] != other[n]] == ["directives"]


def test_workers_do_not_matter() -> None:
    scenario = PickScenario()
    more = replace(scenario, look=replace(scenario.look, workers=4))
    assert scenario_settings(more) == scenario_settings(scenario)
