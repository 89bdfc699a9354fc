# SPDX-License-Identifier: MIT
"""Disks that are full, places that cannot be written, files that vanish meanwhile.

Each is one line and exit status 2; no half of a file has the name of a whole one, no
temporary file is left, and what was done before is kept. A limit on the length of files
acts like a disk that is full.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

import physim_drake.self_learning.exploration as exploration
from physim_drake.cli import main
from physim_drake.datasets.results import read_results
from physim_drake.datasets.results_writer import ResultsWriter
from physim_drake.detection.detector import NetworkDetector
from physim_drake.detection.networks.factory import classes_of
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary
from physim_drake.scenes.dataset import SceneMaker
from tests.cli.estimating import BOTTLE, SCENE, two_images, without_time
from tests.cli.test_detect import write_weights_of
from tests.cli.test_learn import QuietExplorer
from tests.cli.test_pick import SHORT, scenario
from tests.disks import room_for
from tests.synthetic import library as synthetic_library

PROGRAM = (sys.executable, "-c", "from physim_drake.cli import main; main()")
MODELS = ("--models", APC11)
PCA = (*MODELS, "--workers", 1, "--method", "pca-icp")
SMALL = (*MODELS, "--workers", 1, "--expansions", 4, "--hypotheses", 4)
REPORT = (*SMALL, "--methods", "pca-icp", "--masks")

Run = Callable[..., int | str | None]
Refused = Callable[..., str]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs the program and gives its exit status."""

    def call(*arguments: object) -> int | str | None:
        monkeypatch.setattr(sys, "argv", ["physim-drake", *map(str, arguments)])
        with pytest.raises(SystemExit) as caught:
            main()
        return caught.value.code

    return call


@pytest.fixture
def refused(run: Run, capsys: pytest.CaptureFixture[str]) -> Refused:
    """Runs the program, which ends with exit status 2, and returns its one line."""

    def call(*arguments: object) -> str:
        capsys.readouterr()
        assert run(*arguments) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("error: ")
        return line

    return call


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    return two_images(tmp_path / "two")


@pytest.fixture
def one_model(tmp_path: Path) -> Path:
    """A models folder with one small object."""
    folder = tmp_path / "models"
    shutil.copytree(APC11 / "crayola_24_ct", folder / "crayola_24_ct")
    text = (APC11 / "library.yaml").read_text()
    (folder / "library.yaml").write_text("- id: ".join(text.split("- id: ")[:2]))
    return folder


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    path = tmp_path / "own.safetensors"
    return write_weights_of(path, classes_of(ObjectLibrary.load(APC11)))


def files(folder: Path) -> list[str]:
    """All in a folder, by path."""
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*"))


def snapshot(folder: Path) -> list[tuple[str, int, int]]:
    """All in a folder, with what changes when it is written."""
    return [
        (str(path), path.stat().st_mtime_ns, path.stat().st_size)
        for path in sorted((folder, *folder.rglob("*")))
    ]


def test_estimates_before_the_disk_was_full_are_kept(
    run: Run, refused: Refused, dataset: Path, tmp_path: Path
) -> None:
    whole, out = tmp_path / "whole.csv", tmp_path / "r.csv"
    assert run("estimate", dataset, "--out", whole, *PCA) == 0
    progress = whole.with_name("whole.csv.progress").stat().st_size
    with room_for(progress - 1):
        line = refused("estimate", dataset, "--out", out, *PCA)
    assert f"{out}.progress: cannot be written: File too large; free some space" in line
    assert out.read_text().endswith("\n")
    assert next(row.im_id for row in read_results(out)) == 0
    assert run("estimate", dataset, "--out", out, *PCA, "--resume") == 0
    assert without_time(out) == without_time(whole)


def test_pictures_that_do_not_fit_leave_none(
    refused: Refused, dataset: Path, tmp_path: Path
) -> None:
    out, pictures = tmp_path / "r.csv", tmp_path / "pictures"
    with room_for(10_000):
        line = refused("estimate", dataset, "--out", out, *PCA, "--overlays", pictures)
    assert "pictures/000001_000000.png: cannot be written" in line
    assert files(pictures) == []
    assert read_results(out) == []


def test_an_explanation_that_does_not_fit_leaves_none(
    refused: Refused, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    with room_for(50_000):
        line = refused("explain", SCENE, "--image", "1/0", "--out", out, *SMALL)
    assert "000001_000000.html: cannot be written" in line
    assert files(out) == []


def test_a_report_that_does_not_fit_has_no_page_and_goes_on(
    run: Run, refused: Refused, dataset: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    with room_for(50_000):
        line = refused("report", dataset, "--out", out, *REPORT)
    assert "index.html: cannot be written" in line
    assert "index.html" not in files(out)
    assert not any(name.endswith(".tmp") for name in files(out))
    assert run("report", dataset, "--out", out, *REPORT, "--resume") == 0
    assert "index.html" in files(out)


def test_figures_that_do_not_fit_leave_the_earlier_ones(
    run: Run, refused: Refused, dataset: Path, tmp_path: Path
) -> None:
    results, figures = tmp_path / "r.csv", tmp_path / "f.json"
    assert run("estimate", dataset, "--out", results, *PCA, "--images", "1/0") == 0
    figures.write_text("earlier")
    judge = ("evaluate", results, dataset, *MODELS, "--no-vsd", "--json", figures)
    with room_for(100):
        assert f"{figures}: cannot be written" in refused(*judge)
    assert figures.read_text() == "earlier"


def test_detections_that_do_not_fit_leave_none(
    refused: Refused, dataset: Path, weights: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    find = ("detect", dataset, "--out", out / "d.json", "--weights", weights)
    with room_for(1):
        assert "d.json: cannot be written" in refused(*find, "--threads", 1)
    assert files(out) == []


@pytest.mark.parametrize("command", ["generate", "train"])
def test_models_that_do_not_fit_leave_none(
    refused: Refused, one_model: Path, tmp_path: Path, command: str
) -> None:
    out = tmp_path / "out"
    with room_for(20_000):
        line = refused(command, out, "--models", one_model)
    root = out / "data" if command == "train" else out
    assert f"{root / 'models'}: cannot be written" in line
    assert files(root) == ["generation.json", "test"]
    assert '"complete": false' in (root / "generation.json").read_text()


def test_scenes_that_do_not_fit_leave_none_and_are_made_later(
    run: Run, refused: Refused, one_model: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    size = ("--scenes", 1, "--levels", 1, "--objects", "1:1", "--no-noise")
    scenes = ("generate", out, "--models", one_model, *size)
    with room_for(90_000):
        assert "test/000001: cannot be written" in refused(*scenes)
    assert files(out / "test") == []
    assert run(*scenes, "--resume") == 0
    assert "scene_gt.json" in files(out / "test" / "000001")
    assert not any(".tmp" in name for name in files(out))


def test_what_was_learnt_and_does_not_fit_leaves_no_models(
    refused: Refused, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exploration, "Explorer", QuietExplorer)
    known = classes_of(synthetic_library())
    own = write_weights_of(tmp_path / "own.safetensors", known)
    out = tmp_path / "out"
    with room_for(100):
        line = refused("learn", out, "--weights", own)
    assert f"{out / 'models'}: cannot be written" in line
    assert files(out) == []


def test_a_replay_that_does_not_fit_leaves_none_and_is_made_later(
    run: Run, refused: Refused, tmp_path: Path
) -> None:
    cell, out = scenario(tmp_path, SHORT), tmp_path / "out"
    with room_for(1_000_000):
        line = refused("pick", cell, "--record", out)
    assert "replay-001.html: cannot be written" in line
    assert files(out) == ["pick.progress"]
    assert run("pick", cell, "--record", out, "--resume") == 0
    assert files(out) == ["index.html", "pick.progress", "replay-001.html"]


def below_a_file(tmp_path: Path) -> Path:
    """A folder that nobody can make."""
    (tmp_path / "file").write_text("")
    return tmp_path / "file" / "out"


@pytest.mark.parametrize(
    "command",
    [
        ("estimate", SCENE, *PCA, "--out"),
        ("estimate", SCENE, *PCA, "--out", "r.csv", "--trace"),
        ("explain", SCENE, "--image", "1/0", *MODELS, "--out"),
        ("report", SCENE, *MODELS, "--out"),
        ("evaluate", "none.csv", SCENE, "--json"),
        ("generate",),
        ("train",),
        ("pick", "cell.yaml", "--record"),
        ("pick", "cell.yaml", "--json"),
    ],
    ids=lambda command: f"{command[0]} {command[-1]}",
)
def test_a_place_that_cannot_be_is_said_first(
    refused: Refused,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: Sequence[object],
) -> None:
    scenario(tmp_path, SHORT)
    monkeypatch.chdir(tmp_path)
    line = refused(*command, below_a_file(tmp_path))
    assert line.startswith(f"error: {tmp_path / 'file' / 'out'}")
    assert "cannot be written: Not a directory; choose a path" in line
    assert files(tmp_path) == ["cell.yaml", "file"]


def test_detections_that_could_go_nowhere_are_not_looked_for(
    refused: Refused,
    dataset: Path,
    weights: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delattr(NetworkDetector, "detect")
    out = below_a_file(tmp_path)
    line = refused("detect", dataset, "--weights", weights, "--out", out)
    assert f"{out}: cannot be written: Not a directory" in line


@pytest.fixture
def read_only(dataset: Path) -> Iterator[Path]:
    """A dataset with models, in which no one but root may write."""
    shutil.copytree(APC11, dataset / "models")
    folders = [dataset, *(p for p in dataset.rglob("*") if p.is_dir())]
    for folder in folders:
        folder.chmod(0o555)
    yield dataset
    for folder in folders:
        folder.chmod(0o755)


def test_a_dataset_that_may_only_be_read_is_not_written(
    run: Run, refused: Refused, read_only: Path, tmp_path: Path
) -> None:
    before, out = snapshot(read_only), tmp_path / "out"
    results, pictures = tmp_path / "r.csv", ("--overlays", out, "--trace", out)
    assert run("estimate", read_only, "--out", results, *PCA[2:], *pictures) == 0
    assert run("evaluate", results, read_only, "--json", tmp_path / "f.json") == 0
    assert run("report", read_only, "--out", out, *REPORT[2:]) == 0
    assert snapshot(read_only) == before
    if os.geteuid() != 0:
        line = refused("estimate", read_only, "--out", read_only / "r.csv", *PCA)
        assert "cannot be written: Permission denied" in line


def remove(path: Path) -> None:
    shutil.rmtree(path) if path.is_dir() else path.unlink()


@pytest.mark.parametrize(
    ("lost", "message"),
    [
        ("test/000001/depth/000001.png", "depth/000001.png: cannot be read"),
        ("test/000001/mask_visib/000001_000002.png", "2.png: cannot be read"),
        ("test", "cannot be read: No such file"),
    ],
)
def test_files_of_a_dataset_that_vanish_are_named(
    run: Run,
    dataset: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    lost: str,
    message: str,
) -> None:
    after_first(monkeypatch, ResultsWriter, "write_image", dataset / lost)
    out = tmp_path / "r.csv"
    assert run("estimate", dataset, "--out", out, *PCA, "--masks") == 3
    printed = " ".join(capsys.readouterr().err.split())
    assert f"1/1: failed: {dataset}" in printed
    assert message in printed
    assert [row.im_id for row in read_results(out)] == [0]


def after_first(
    monkeypatch: pytest.MonkeyPatch, kind: type, method: str, lost: Path
) -> None:
    """Removes a file or folder after the first call of a method."""
    call = getattr(kind, method)

    def called(self: Any, *arguments: Any) -> Any:
        result = call(self, *arguments)
        if lost.exists():
            remove(lost)
        return result

    monkeypatch.setattr(kind, method, called)


def test_meshes_that_vanish_are_not_missed(
    run: Run, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    models, out = dataset / "models", tmp_path / "r.csv"
    shutil.copytree(APC11, models)
    after_first(monkeypatch, ResultsWriter, "write_image", models)
    assert run("estimate", dataset, "--out", out, *PCA[2:]) == 0
    assert [row.object_id for row in read_results(out)] == [BOTTLE, BOTTLE]
    assert not models.exists()


def test_results_that_vanish_are_not_written_on(
    refused: Refused, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out" / "r.csv"
    out.parent.mkdir()
    after_first(monkeypatch, ResultsWriter, "write_image", out.parent)
    line = refused("estimate", dataset, "--out", out, *PCA)
    assert f"{out}: was removed or replaced during the run" in line
    assert not out.parent.exists()


def test_drake_models_that_vanish_are_named_and_made_again(
    run: Run,
    refused: Refused,
    one_model: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out = tmp_path / "out"
    size = ("--scenes", 2, "--levels", 1, "--objects", "1:1", "--no-noise")
    scenes = ("generate", out, "--models", one_model, *size)
    with monkeypatch.context() as patch:
        after_first(patch, SceneMaker, "make", out / "drake_models")
        line = refused(*scenes)
    model = out / "drake_models" / "obj_000001" / "crayola_24_ct.sdf"
    assert f"{model}: was removed during the run" in line
    assert "000001" in files(out / "test")
    assert run(*scenes, "--resume") == 0
    assert "000002" in files(out / "test")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
def test_an_output_that_takes_no_more_is_one_line(
    run: Run, dataset: Path, tmp_path: Path
) -> None:
    results = tmp_path / "r.csv"
    assert run("estimate", dataset, "--out", results, *PCA, "--images", "1/0") == 0
    judge = ("evaluate", results, dataset, *MODELS, "--no-vsd")
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*PROGRAM, *map(str, judge)], stdout=full, stderr=subprocess.PIPE, text=True
        )
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")
    assert "No space left on device" in line
    assert done.returncode == 2


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A real disk of 128 KiB. Skips if it cannot be mounted."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=128k", "tmpfs", str(folder)]
    try:
        made = subprocess.run(mount, capture_output=True, text=True)
    except FileNotFoundError:
        pytest.skip("there is no program to mount disks with")
    if made.returncode:
        pytest.skip(f"no disk may be mounted here: {made.stderr.strip()}")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_disk_that_is_full(
    run: Run, refused: Refused, dataset: Path, small_disk: Path
) -> None:
    out, pictures = small_disk / "r.csv", small_disk / "pictures"
    draw = ("estimate", dataset, "--out", out, *PCA, "--overlays", pictures)
    line = refused(*draw)
    assert "000001_000000.png: cannot be written: No space left on device" in line
    assert files(small_disk) == ["pictures", "r.csv", "r.csv.progress"]
    assert run(*draw[:-2], "--resume") == 0
    assert len(read_results(out)) == 2
