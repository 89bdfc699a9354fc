# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from physim_drake.cli import main
from physim_drake.detection.detector import NetworkDetector
from physim_drake.detection.networks.factory import ObjectClass
from physim_drake.episodes.runner import EpisodeRunner
from physim_drake.errors import InputError
from physim_drake.systems import perception_config
from tests.cli.test_detect import write_weights_of

ONE = """
objects: {names: [dove_beauty_bar], count: [1, 1], levels: [1]}
look: {noise: false, method: pca-icp, detector: oracle}
"""
NETWORK = ONE.replace("detector: oracle", "weights: own.safetensors")
SOAP = ObjectClass(9, "dove_beauty_bar")
FRAME = """
directives:
- add_directives: {{file: "package://physim_drake_models/pick_cell/pick_cell.dmd.yaml"}}
- add_frame:
    name: elsewhere
    X_PF: {{base_frame: world, translation: {place}}}
"""


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> int:
    monkeypatch.setattr(sys, "argv", ["physim-drake", "pick", *map(str, arguments)])
    with pytest.raises(SystemExit) as exit_:
        main()
    code = exit_.value.code
    return code if isinstance(code, int) else 0


def scenario(folder: Path, text: str) -> Path:
    path = folder / "cell.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gravity: 9", "['gravity'] were unknown to the schema"),
        (
            'directives: [{add_directives: {file: "package://scenario/no.yaml"}}]',
            "no.yaml",
        ),
        (
            "objects: {names: [teapot], count: [1, 1], levels: [1]}",
            "no object 'teapot'",
        ),
        (
            ONE
            + FRAME.format(place=[3.0, 0.0, 0.75])
            + "pick_area: {frame: elsewhere, half_extents: [0.2, 0.2]}",
            "the arm does not reach it at (3, 0, 0.75) m",
        ),
        (
            ONE + "planner: {home: [-1.01, 2.5, 1.07, -1.38, -0.37, -1.32, 0.0]}",
            "arm_left_joint_2_l is at 2.500 rad, its limits",
        ),
        (
            ONE.replace("method: pca-icp", "views: [{distance: 2.5}]"),
            "the camera sees nothing of pick_area",
        ),
    ],
    ids=[
        "unknown key",
        "missing model",
        "missing object",
        "unreachable table",
        "joint limits violated",
        "camera that sees nothing",
    ],
)
def test_a_scenario_that_cannot_work_is_one_line_and_exit_status_2(
    text: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    path = scenario(tmp_path, text)
    assert run(monkeypatch, path) == 2
    errors = capfd.readouterr().err.strip().splitlines()
    (line,) = [e for e in errors if e.startswith("error: ")]
    assert line.startswith(f"error: {path}: ")
    assert message in line
    assert line is errors[-1]
    assert not any("Traceback" in e for e in errors)


def pickled(path: Path) -> None:
    torch.save({}, path)


def of_another(path: Path) -> None:
    write_weights_of(path, (ObjectClass(9, "teapot"),))


def cut_short(path: Path) -> None:
    write_weights_of(path, (SOAP,))
    path.write_bytes(path.read_bytes()[:-5])


def not_there(path: Path) -> None:
    """Leaves nothing."""


BAD_WEIGHTS: dict[Callable[[Path], None], str] = {
    pickled: "is a pickle, and pickles are never loaded",
    of_another: "object 9 of the library is dove_beauty_bar, here it is teapot",
    cut_short: "is damaged or not a safetensors file",
    not_there: "cannot be read: No such file or directory",
}


@pytest.mark.parametrize("write", BAD_WEIGHTS, ids=lambda write: write.__name__)
@pytest.mark.parametrize("named_by", ["scenario", "option", "package"])
def test_weights_that_cannot_be_used_are_one_line_and_exit_status_2(
    write: Callable[[Path], None],
    named_by: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    weights = tmp_path / "own.safetensors"
    write(weights)
    options: list[str | Path] = []
    text = NETWORK
    if named_by != "scenario":
        text = ONE  # whose oracle is overruled
        options = ["--detector", "network"]
    if named_by == "option":
        options += ["--weights", weights]
    if named_by == "package":
        monkeypatch.setattr(perception_config, "DETECTOR", weights)
    path = scenario(tmp_path, text)
    assert run(monkeypatch, path, *options) == 2
    (line,) = [e for e in capfd.readouterr().err.splitlines() if "error: " in e]
    assert line.startswith(f"error: {path}: {weights}: ")
    assert BAD_WEIGHTS[write] in line
    assert "or take the detector `oracle`" in line


def test_an_oracle_takes_no_weights(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    path = scenario(tmp_path, ONE)
    assert run(monkeypatch, path, "--weights", "w.safetensors") == 2
    assert "--weights: given with an oracle" in capfd.readouterr().err


def test_a_cell_whose_network_sees_nothing_looks_again(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    write_weights_of(tmp_path / "own.safetensors", (SOAP,))
    asked = []

    def detect(self: object, color: np.ndarray, depth: object) -> tuple[()]:
        asked.append(color.shape)
        return ()

    monkeypatch.setattr(NetworkDetector, "detect", detect)
    path = scenario(tmp_path, NETWORK + "max_duration: 2.0\n")
    assert run(monkeypatch, path) == 0
    assert asked == [(480, 640, 3)]
    assert "0 of 1 object cleared" in capfd.readouterr().err


def test_a_file_that_is_missing_is_named(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    assert run(monkeypatch, tmp_path / "none.yaml") == 2
    assert "none.yaml: cannot be read" in capfd.readouterr().err


def test_figures_report_and_replay(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    path = scenario(tmp_path, ONE + "max_duration: 2.0\n")
    out, figures = tmp_path / "report", tmp_path / "figures.json"
    code = run(monkeypatch, path, "--seed", "3", "--record", out, "--json", figures)
    assert code == 0
    printed = capfd.readouterr()
    assert "real-time" in printed.out
    closing = f"The robot cleared 0 of 1 object in 1 episode. Open {out / 'index.html'}"
    assert printed.out.splitlines()[-1] == closing
    assert "episode 1, dove_beauty_bar is left: it was never picked" in " ".join(
        printed.out.split()
    )
    assert "episode 1 of 1: 0 of 1 object cleared" in printed.err
    values = json.loads(figures.read_text(encoding="utf-8"))
    assert values["objects"] == 1
    assert values["cleared"] == values["picks"] == 0
    assert values["simulated_time"] == pytest.approx(2.0)
    assert values["real_time_factor"] > 0
    assert len(values["episodes"]) == 1
    assert "dove_beauty_bar" in (out / "index.html").read_text(encoding="utf-8")
    replay = (out / "replay-001.html").read_text(encoding="utf-8")
    assert "<html" in replay
    assert "setanimation" in replay or "set_animation" in replay


SHORT = ONE + "max_duration: 0.3\n"
TIMES = ("wall_time", "real_time_factor", "stages")


@pytest.fixture
def done(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The episodes that were run to their end, from 0."""
    done: list[int] = []
    run_episode = EpisodeRunner.run

    def counted(self: EpisodeRunner, number: int, *arguments: Any) -> Any:
        result = run_episode(self, number, *arguments)
        done.append(number)
        return result

    monkeypatch.setattr(EpisodeRunner, "run", counted)
    return done


def without_times(folder: Path) -> dict[str, str]:
    """The files of a run, without the clock's figures."""
    files = {}
    for path in sorted(folder.rglob("*")):
        if path.is_dir() or path.suffix == ".progress":
            continue
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".json":
            values = json.loads(text)
            for entry in (values, *values["episodes"]):
                for name in TIMES:
                    del entry[name]
            text = json.dumps(values)
        if path.name == "index.html":
            last = r"(?<=<td>)[\d.]+ s</td>(<td>[\d.]+</td>)?(?=\s*</tr>)"
            text = re.sub(last, "", text)
            text = re.sub(r"real-time factor\n[\d.]+", "", text)
        files[str(path.relative_to(folder))] = text
    return files


def test_episodes_that_are_done_are_not_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, done: list[int]
) -> None:
    """And all comes out as if nothing had happened."""
    path = scenario(tmp_path, SHORT)

    def go(folder: Path, *more: str) -> int:
        places = ("--record", folder / "report", "--json", folder / "figures.json")
        return run(monkeypatch, path, "--episodes", "2", *places, *more)

    whole, broken = tmp_path / "whole", tmp_path / "broken"
    whole.mkdir()
    broken.mkdir()
    assert go(whole) == 0
    expected = without_times(whole)
    assert len(expected) == 4

    counted = EpisodeRunner.run

    def cut_off(self: EpisodeRunner, number: int, *arguments: Any) -> Any:
        if number == 1:
            raise InputError("the machine", "stopped")
        return counted(self, number, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(EpisodeRunner, "run", cut_off)
        assert go(broken, "--resume") == 2
    assert set(without_times(broken)) == {"report/replay-001.html"}

    done.clear()
    assert go(broken, "--resume", "--workers", "2") == 0
    assert done == [1]
    assert without_times(broken) == expected

    (broken / "report" / "replay-001.html").unlink()
    assert go(broken, "--resume") == 0
    assert done == [1, 0]
    assert without_times(broken) == expected
    (broken / "report" / "index.html").unlink()
    assert go(broken, "--resume") == 0
    assert done == [1, 0]
    assert without_times(broken) == expected


def test_figures_alone_can_be_resumed_and_added_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, done: list[int]
) -> None:
    path, figures = scenario(tmp_path, SHORT), tmp_path / "figures.json"
    assert run(monkeypatch, path, "--json", figures) == 0
    more = ("--json", figures, "--resume", "--episodes")
    assert run(monkeypatch, path, *more, "2") == 0
    assert done == [0, 1]
    values = json.loads(figures.read_text(encoding="utf-8"))
    assert [entry["episode"] for entry in values["episodes"]] == [0, 1]
    assert run(monkeypatch, path, *more, "1") == 0
    assert len(json.loads(figures.read_text(encoding="utf-8"))["episodes"]) == 1
    assert run(monkeypatch, path, "--json", figures) == 0
    assert done == [0, 1, 0]


def test_what_cannot_be_resumed_is_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    done: list[int],
) -> None:
    path, figures = scenario(tmp_path, SHORT), tmp_path / "figures.json"

    def said(*arguments: str | Path) -> str:
        assert run(monkeypatch, path, *arguments, "--resume") == 2
        (line,) = [e for e in capfd.readouterr().err.splitlines() if "error: " in e]
        return line

    assert run(monkeypatch, path, "--json", figures) == 0
    capfd.readouterr()
    of = f"error: {figures}.progress: "
    line = said("--json", figures, "--seed", "5")
    assert f"{of}random_seed: the run began with '0', this one has '5'; " in line
    line = said("--json", figures, "--detector", "network")
    assert f"{of}look.detector: the run began with 'oracle', " in line
    scenario(tmp_path, SHORT + "task: {tries: 2}\n")
    line = said("--json", figures)
    assert f"{of}task.tries: the run began with '3', this one has '2'; " in line
    for nowhere in ((), ("--json", "-"), ("--json", "/dev/stdout")):
        line = said(*nowhere)
        assert "--resume: goes on with what --record or --json kept" in line
    assert done == [0]
