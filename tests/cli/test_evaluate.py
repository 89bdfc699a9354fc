# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from physim_drake import __version__
from physim_drake.cli import main
from physim_drake.datasets.bop import BopDataset, image_ids
from physim_drake.datasets.results import ResultRow
from physim_drake.datasets.results_writer import ResultsWriter
from tests.datasets.tiny import write_tiny


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> int | str | None:
    """The exit status of the program."""
    monkeypatch.setattr(sys, "argv", ["physim-drake", *map(str, arguments)])
    with pytest.raises(SystemExit) as caught:
        main()
    return caught.value.code


def test_version_and_help(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "--version") == 0
    assert capsys.readouterr().out == f"physim-drake {__version__}\n"
    assert run(monkeypatch, "evaluate", "--help") == 0
    assert "Example: physim-drake evaluate results.csv" in capsys.readouterr().out


def test_help_imports_nothing_heavy() -> None:
    code = "import sys, physim_drake.cli; print('numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "False\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["none.csv", "tiny"], "none.csv: cannot be read: No such file"),
        (["none.csv", "nowhere"], 'nowhere: has no folder "test"'),
        (["none.csv", "tiny", "--split", "val"], 'tiny: has no folder "val"'),
    ],
)
def test_errors_are_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    write_tiny(tmp_path / "tiny")
    monkeypatch.chdir(tmp_path)
    assert run(monkeypatch, "evaluate", *arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"error: {message}")
    assert captured.err.count("\n") == 1


def test_an_interrupt_exits_130(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(path: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("physim_drake.datasets.results.read_results", interrupt)
    write_tiny(tmp_path)
    assert run(monkeypatch, "evaluate", "x.csv", tmp_path) == 130


def test_true_poses_are_perfect(
    shared: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    dataset = BopDataset(shared / "data" / "real-ycb")
    results, report = tmp_path / "results.csv", tmp_path / "report.json"
    with ResultsWriter(results) as writer:
        for image in image_ids(dataset.targets()):
            rows = [
                ResultRow(*image, pose.object_id, 1.0, pose.X_CO)
                for pose in dataset.ground_truth(*image)
            ]
            writer.write_image(*image, rows, time=2.5)
    assert run(monkeypatch, "evaluate", results, dataset.root, "--json", report) == 0
    printed = capsys.readouterr().out
    assert "2.50 s an image (1 of 1 image)" in printed
    overall = json.loads(report.read_text())["overall"]
    assert overall["ar_vsd"] == overall["ar_mssd"] == overall["ar_mspd"] == 1.0
    assert overall["recall_5deg_1cm"] == 1.0
    assert overall["geodesic_mean_deg"] < 1e-4
