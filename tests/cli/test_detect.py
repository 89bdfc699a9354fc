# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import pytest
import torch

from physim_drake.datasets.bop import BopDataset
from physim_drake.datasets.detections import load_detections
from physim_drake.detection.networks.config import NetworkKind
from physim_drake.detection.networks.factory import ObjectClass, make_network
from physim_drake.detection.networks.weights import save_weights
from physim_drake.models import APC11
from tests.datasets.tiny import HEIGHT, WIDTH, write_tiny
from tests.detection.scenes import tiny

PROGRAM = [sys.executable, "-c", "from physim_drake.cli import main; main()"]


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*PROGRAM, "detect", *map(str, arguments)], capture_output=True, text=True
    )


def check_refused(result: subprocess.CompletedProcess[str], text: str) -> None:
    assert result.returncode == 2, result.stderr
    (line,) = result.stderr.strip().splitlines()
    assert line.startswith("error: ")
    assert text in line


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    return write_tiny(tmp_path / "tiny")


def write_weights(
    path: Path, *ids: int, kind: NetworkKind = NetworkKind.FASTER_RCNN
) -> Path:
    """Those of an untrained network."""
    classes = tuple(ObjectClass(i, f"object {i}") for i in ids)
    return write_weights_of(path, classes, kind)


def write_weights_of(
    path: Path,
    classes: tuple[ObjectClass, ...],
    kind: NetworkKind = NetworkKind.FASTER_RCNN,
) -> Path:
    """Those of an untrained network for certain classes."""
    torch.manual_seed(0)
    network = make_network(tiny(kind), len(classes))
    save_weights(path, network.state_dict(), tiny(kind), classes)
    return path


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    return write_weights(tmp_path / "weights.safetensors", 1, 2)


def test_writes_detections_that_can_be_read(
    dataset: Path, weights: Path, tmp_path: Path
):
    out, overlays = tmp_path / "detections.json", tmp_path / "drawn"
    result = run(
        dataset, "--out", out, "--weights", weights, "--least-score", 0.01,
        "--overlays", overlays, "--drawn-score", 0, "--threads", 1,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert "detections in 2 images" in result.stdout
    entries = json.loads(out.read_text())
    assert {e["image_id"] for e in entries} == {0, 7}
    found = load_detections(out, BopDataset(dataset))
    for d in found[3, 0]:
        assert d.object_id in (1, 2)
        assert d.mask is not None
        assert d.mask.shape == (HEIGHT, WIDTH)
        assert 0.0 <= d.score <= 1.0
    for name in ("000003_000000.png", "000003_000007.png"):
        picture = cv2.imread(str(overlays / name))
        assert picture is not None
        assert picture.shape == (HEIGHT, WIDTH, 3)


def test_weights_for_other_objects(dataset: Path, tmp_path: Path):
    other = write_weights(tmp_path / "other", 1, 9)
    result = run(dataset, "--out", tmp_path / "d.json", "--weights", other)
    check_refused(result, "are weights for other objects")
    assert not (tmp_path / "d.json").exists()


def test_weights_for_objects_of_another_name(
    dataset: Path, weights: Path, tmp_path: Path
):
    (dataset / "models").mkdir()
    library = (APC11 / "library.yaml").read_text()
    (dataset / "models" / "library.yaml").write_text(library)
    for folder in APC11.iterdir():
        if folder.is_dir():
            (dataset / "models" / folder.name).symlink_to(folder)
    result = run(dataset, "--out", tmp_path / "d.json", "--weights", weights)
    check_refused(result, "is crayola_24_ct, here it is object 1")


def test_truncated_weights(dataset: Path, weights: Path, tmp_path: Path):
    weights.write_bytes(weights.read_bytes()[:-7])
    result = run(dataset, "--out", tmp_path / "d.json", "--weights", weights)
    check_refused(result, "is damaged or not a safetensors file")


def test_a_pickle(dataset: Path, tmp_path: Path):
    torch.save({}, tmp_path / "weights.pt")
    result = run(
        dataset, "--out", tmp_path / "d.json", "--weights", tmp_path / "weights.pt"
    )
    check_refused(result, "is a pickle, and pickles are never loaded")


def test_images_without_colour(dataset: Path, weights: Path, tmp_path: Path):
    (dataset / "test/000003/rgb").rename(dataset / "lost")
    result = run(dataset, "--out", tmp_path / "d.json", "--weights", weights)
    check_refused(result, "has no colour")


def test_a_folder_that_cannot_be_written(dataset: Path, weights: Path, tmp_path: Path):
    result = run(dataset, "--out", tmp_path / "no" / "d.json", "--weights", weights)
    check_refused(result, "cannot be written")
