# SPDX-License-Identifier: MIT
"""A wrong unit is told, and nothing else is taken for one."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from physim_drake.cli import main
from physim_drake.datasets.bop import BopDataset
from physim_drake.datasets.detections import load_detections
from physim_drake.errors import InputError
from physim_drake.estimation.estimator import EstimationConfig, Method, estimate_scene
from physim_drake.estimation.scale_check import scale_warning
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.observation import Detection, RgbdObservation
from tests.documents import EXAMPLE
from tests.synthetic import library, pair_apart, synthesize

REAL = Path(__file__).parents[3] / "shared" / "data"
ALONE = replace(EstimationConfig(Method.PCA_ICP), least_confidence=1.0)

Dataset = tuple[BopDataset, ObjectLibrary]


@cache
def look() -> tuple[RgbdObservation, tuple[Detection, ...]]:
    scene = synthesize(pair_apart(), noise=0.5)
    return scene.observation, scene.detections


def scaled(observation: RgbdObservation, scale: float) -> RgbdObservation:
    """What is read with a `depth_scale` that is wrong by this factor."""
    return replace(observation, depth=observation.depth * np.float32(scale))


@pytest.mark.parametrize("scale", [0.1, 0.2, 5.0, 10.0])
def test_a_wrong_unit_of_depth_is_told(scale: float) -> None:
    observation, detections = look()
    warning = scale_warning(scaled(observation, scale), detections, library())
    factor = float(warning.split("about ")[1].split()[0])
    assert 0.6 * scale < factor < 1.5 * scale
    assert "depth_scale" in warning


@pytest.mark.parametrize("scale", [0.5, 0.8, 1.0, 1.25, 1.6])
def test_sizes_that_can_be_right_are_not_doubted(scale: float) -> None:
    observation, detections = look()
    assert scale_warning(scaled(observation, scale), detections, library()) == ""


def test_all_detections_must_agree() -> None:
    observation, (first, second) = look()
    left, top = first.box[:2]
    hidden = replace(first, box=np.array([left, top, left + 4, top + 4]))
    everything = replace(first, box=np.array([0.0, 0.0, 320.0, 240.0]))
    assert scale_warning(observation, [hidden], library())
    assert scale_warning(observation, [everything], library())
    for wrong in (hidden, everything):
        assert scale_warning(observation, [wrong, second], library()) == ""


def test_what_was_not_measured_says_nothing() -> None:
    observation, (first, _) = look()
    far = scaled(observation, 10.0)
    nothing = replace(far, depth=far.depth.copy())
    left, top, right, bottom = first.box.astype(int)
    nothing.depth[top:bottom, left:right] = 0
    unseen = Detection.unseen(first.object_id, 240, 320)
    unknown = replace(first, object_id=999)
    assert scale_warning(far, [first], library())
    assert scale_warning(nothing, [first], library()) == ""
    assert scale_warning(far, [unseen, unknown], library()) == ""
    assert scale_warning(far, [], library()) == ""


def test_an_estimate_warns_and_stays_what_it_is() -> None:
    observation, detections = look()
    near = scaled(observation, 0.2)
    estimate = estimate_scene(near, library(), detections, ALONE)
    assert "about 0.22 times as large" in estimate.warning
    missing = [o for o in estimate.objects if not o.found]
    assert missing
    for item in missing:
        assert item.reason.endswith(f"; {estimate.warning}")
        assert estimate.warning not in estimate.reason_alone(item)
    assert str(estimate).count(estimate.warning) == 1
    right = estimate_scene(observation, library(), detections, ALONE)
    assert right.warning == ""
    assert "warning" not in str(right)


def test_an_error_about_the_surface_says_it_too() -> None:
    observation, detections = look()
    far = scaled(observation, 10.0)
    with pytest.raises(InputError, match=r"only .* points.*times as large as") as error:
        estimate_scene(far, library(), detections, ALONE)
    assert error.value.field == "surface"


def test_the_console_says_it_once_an_image(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    root = tmp_path / "tabletop"
    shutil.copytree(EXAMPLE, root)
    camera = root / "test" / "000001" / "scene_camera.json"
    cameras = json.loads(camera.read_text())
    cameras["0"]["depth_scale"] = 0.2
    camera.write_text(json.dumps(cameras))
    options = ["--method", "pca-icp", "--least-confidence", "0.9", "--workers", "1"]
    files = [str(root), "--models", str(APC11), "--out", str(tmp_path / "r.csv")]
    monkeypatch.setattr(sys, "argv", ["physim-drake", "estimate", *files, *options])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr().err
    assert ended.value.code == 0
    assert "not found: confidence" in said
    assert said.count("depth_scale") == 1
    assert "1/0: warning: at the measured depth (0.11 m)" in said


def example() -> Dataset:
    return BopDataset(EXAMPLE), ObjectLibrary.load(APC11)


def given(name: str) -> Callable[[], Dataset]:
    def load() -> Dataset:
        if not (REAL / name).is_dir():
            pytest.skip(f"{name} is not here")
        data = BopDataset(REAL / name)
        return data, ObjectLibrary.load(data.models)

    return load


@pytest.mark.parametrize(
    "load",
    [example, *map(given, ("apc11-dev", "real-ycb", "real-scene"))],
    ids=["example", "apc11-dev", "real-ycb", "real-scene"],
)
def test_no_image_of_a_right_dataset_is_doubted(load: Callable[[], Dataset]) -> None:
    data, models = load()
    detections = load_detections(data.root / "detections.json", data)
    for image, found in detections.items():
        observation = data.observation(*image)
        assert scale_warning(observation, found, models) == "", image
        assert scale_warning(scaled(observation, 0.2), found, models), image
        assert scale_warning(scaled(observation, 5.0), found, models), image
