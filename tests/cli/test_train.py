# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch

from physim_drake.detection.detector import NetworkDetector
from physim_drake.models import APC11
from tests.cli.test_detect import write_weights
from tests.datasets.tiny import write_tiny

PROGRAM = [sys.executable, "-c", "from physim_drake.cli import main; main()"]
SMALL = [
    "--scenes", "2", "--views", "1", "--test-images", "2", "--steps", "6",
    "--batch", "1", "--image-size", "64", "--save-every", "2", "--workers", "1",
    "--threads", "1", "--device", "cpu", "--precision", "float32",
]  # fmt: skip


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*PROGRAM, "train", *map(str, arguments)], capture_output=True, text=True
    )


def check_refused(result: subprocess.CompletedProcess[str], text: str) -> None:
    assert result.returncode == 2, result.stderr
    lines = result.stderr.strip().splitlines()
    assert [line for line in lines if line.startswith("error: ")] == lines[-1:]
    assert text in lines[-1]
    assert "Traceback" not in result.stderr


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two of the objects."""
    folder = tmp_path_factory.mktemp("models")
    lines = (APC11 / "library.yaml").read_text().split("- id: ")
    (folder / "library.yaml").write_text("- id: ".join([*lines[:3]]))
    for source in APC11.iterdir():
        if source.is_dir():
            (folder / source.name).symlink_to(source)
    return folder


@pytest.fixture(scope="module")
def trained(models: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that was killed and resumed."""
    out = tmp_path_factory.mktemp("run") / "out"
    command = [*PROGRAM, "train", str(out), "--models", str(models), *SMALL]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    while not (out / "state.safetensors").exists():
        assert process.poll() in (None, 0)
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    result = run(out, "--models", models, *SMALL, "--resume")
    assert result.returncode == 0, result.stderr
    assert "detector.safetensors: boxes 0." in result.stdout
    return out


def test_what_a_run_leaves(trained: Path):
    log = json.loads((trained / "training.json").read_text())
    assert log["losses"][-1]["step"] == log["tests"][-1]["step"] == 6
    assert log["tests"][-1]["images"] == 2
    assert (trained / "training.png").read_bytes().startswith(b"\x89PNG")
    assert len(list((trained / "data/test").glob("*/rgb/*.png"))) == 2
    assert len(list((trained / "test/test").glob("*/rgb/*.png"))) == 2


def test_the_weights_can_be_used(trained: Path):
    detector = NetworkDetector.load(trained / "detector.safetensors")
    names = [c.name for c in detector.classes]
    assert names == ["crayola_24_ct", "expo_dry_erase_board_eraser"]


def write_empty(root: Path) -> Path:
    """Writes a dataset that shows no object."""
    data = write_tiny(root)
    for path in data.glob("test/*/mask_visib/*.png"):
        path.write_bytes((data / "test/000003/rgb/000000.png").read_bytes())
    (data / "test/000003/scene_gt.json").unlink()
    (data / "test_targets_bop19.json").write_text("[]")
    return data


def test_learning_on_from_two_datasets_after_a_start_with_a_wrong_one(
    trained: Path, models: Path, tmp_path: Path
):
    """Neither settings nor packed images of that start stand in the way."""
    out, packed = tmp_path / "out", tmp_path / "out" / "packed"
    weights = trained / "detector.safetensors"
    start = [out, "--models", models, "--start", weights, *SMALL]
    empty = write_empty(tmp_path / "empty")
    result = run(*start, "--data", trained / "test", "--data", empty)
    check_refused(result, "shows no object")
    assert [path.name for path in packed.iterdir()] == ["1"]
    data = [str((trained / name).resolve()) for name in ("data", "test")]
    result = run(*start, "--data", data[0], "--data", data[1], "--resume")
    assert result.returncode == 0, result.stderr
    log = json.loads((out / "training.json").read_text())
    assert log["settings"]["data"] == data
    assert not (out / "data").exists()
    for number, name in enumerate(data, start=1):
        folder = packed / str(number)
        origin = json.loads((folder / "images.json").read_text())["origin"]
        assert str((folder / origin["dataset"]).resolve()) == name


def test_a_folder_in_use_is_kept(trained: Path, models: Path):
    check_refused(run(trained, "--models", models, *SMALL), "is not empty")


def test_resuming_with_other_settings(trained: Path, models: Path):
    result = run(trained, "--models", models, *SMALL, "--resume", "--seed", "1")
    check_refused(result, "resume with the settings of the earlier run")


def test_start_weights_of_another_network(tmp_path: Path, models: Path):
    other = write_weights(tmp_path / "other.safetensors", 1, 9)
    result = run(tmp_path / "out", "--models", models, "--start", other, *SMALL)
    check_refused(result, "are weights of another backbone")


def test_no_share_is_kept_of_weights_for_other_objects(tmp_path: Path, trained: Path):
    start = ["--start", trained / "detector.safetensors", "--start-share", "0.5"]
    result = run(tmp_path / "out", "--models", APC11, *start, *SMALL)
    check_refused(result, "are weights for other objects")


def test_no_share_is_kept_of_nothing(tmp_path: Path, models: Path):
    result = run(tmp_path / "out", "--models", models, "--start-share", "0.5", *SMALL)
    check_refused(result, "is given without weights to start from")


def test_a_pickle_to_start_from(tmp_path: Path, models: Path):
    torch.save({}, tmp_path / "weights.pt")
    result = run(
        tmp_path / "out", "--models", models, "--start", tmp_path / "weights.pt", *SMALL
    )
    check_refused(result, "pickles are never loaded")


def test_an_empty_training_set(tmp_path: Path, models: Path):
    (tmp_path / "data" / "test").mkdir(parents=True)
    result = run(
        tmp_path / "out", "--models", models, "--data", tmp_path / "data", *SMALL
    )
    check_refused(result, "holds no scene")


def test_a_training_set_that_shows_nothing(tmp_path: Path, models: Path):
    data = write_empty(tmp_path / "data")
    result = run(tmp_path / "out", "--models", models, "--data", data, *SMALL)
    check_refused(result, "shows no object")
    assert list((tmp_path / "out").iterdir()) == []


def test_a_full_disk(tmp_path: Path, models: Path):
    """A limit on the size of files acts like one."""
    program = f"{sys.executable} -c '{PROGRAM[2]}'"
    result = subprocess.run(
        ["bash", "-c", f"ulimit -f 20; exec {program} train out --models {models}"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    check_refused(result, "cannot be written")


def test_a_device_that_is_not_there(tmp_path: Path, models: Path):
    if torch.cuda.is_available():
        pytest.skip("there is a GPU")
    result = run(tmp_path / "out", "--models", models, "--device", "cuda")
    check_refused(result, "--device: is cuda, which is not here")
    assert not (tmp_path / "out").exists()
