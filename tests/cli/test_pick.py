# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from physim_drake.cli import main
from physim_drake.detection.detector import NetworkDetector
from physim_drake.detection.networks import ObjectClass
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
    pickled: "is a pickle, not safetensors; pickles are never loaded",
    of_another: "object 9 of the library is dove_beauty_bar, here it is teapot",
    cut_short: "is damaged or no safetensors file",
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
    assert "0 of 1 objects cleared" in capfd.readouterr().err


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
    assert "episode 1, dove_beauty_bar is left: it was never picked" in " ".join(
        printed.out.split()
    )
    assert "episode 1 of 1: 0 of 1 objects cleared" in printed.err
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
