# SPDX-License-Identifier: MIT
from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from physim_drake.camera import CameraIntrinsics
from physim_drake.cli import main
from physim_drake.cli.estimate_image import named_boxes, read_image
from physim_drake.errors import InputError
from physim_drake.models import APC11
from tests.datasets.tiny import HEIGHT, WIDTH, depth_image, write_image

SCENE = Path(__file__).parents[2] / "examples/data/tabletop/test/000001"
CAMERA = CameraIntrinsics(640, 480, 615.0, 615.0, 319.5, 239.5)
KNOWN = {"mug": 3, "box=a": 7}


def test_an_image_is_read_in_metres_with_its_intrinsics(tmp_path: Path) -> None:
    write_image(tmp_path / "d.png", depth_image())
    observation = read_image(tmp_path / "d.png", None, "10,11,5.5,3.5", 1e-4)
    assert observation.intrinsics == CameraIntrinsics(WIDTH, HEIGHT, 10, 11, 5.5, 3.5)
    np.testing.assert_allclose(observation.depth, depth_image() * 1e-4, rtol=1e-6)


@pytest.mark.parametrize(
    ("intrinsics", "scale", "text"),
    [
        ("10,11,5.5", 1e-3, "--intrinsics: is '10,11,5.5'"),
        ("10,11,5.5,nan", 1e-3, "--intrinsics"),
        ("10,11,5.5,3.5", 0.0, "--depth-scale: is 0"),
        ("10,11,5.5,3.5", 1000.0, "give metres per unit"),
        ("615,615,319.5,239.5", 1e-3, "do not fit an image of 12 x 8"),
    ],
)
def test_a_value_that_cannot_be_meant_is_named(
    tmp_path: Path, intrinsics: str, scale: float, text: str
) -> None:
    write_image(tmp_path / "d.png", depth_image())
    with pytest.raises(InputError, match=re.escape(text)):
        read_image(tmp_path / "d.png", None, intrinsics, scale)


def test_boxes_are_read_by_name() -> None:
    mug, box = named_boxes(["mug=1,2,30,40", "box=a=5,6,7,8"], KNOWN, CAMERA)
    assert (mug.object_id, mug.box.tolist()) == (3, [1, 2, 30, 40])
    assert box.object_id == 7


def test_without_boxes_every_model_is_looked_for_everywhere() -> None:
    found = named_boxes([], KNOWN, CAMERA)
    assert [d.object_id for d in found] == [3, 7]
    assert found[0].box.tolist() == [0, 0, 640, 480]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("cup=1,2,3,4", "the models are mug, box=a"),
        ("mug=1,2,3", "give NAME=left,top,right,bottom"),
        ("mug", "give NAME=left,top,right,bottom"),
        ("mug=700,2,800,40", "lies outside the image of 640 x 480"),
        ("mug=300,200,60,50", "of x, y, width, height that is"),
    ],
)
def test_a_box_that_cannot_be_meant_is_named(text: str, problem: str) -> None:
    with pytest.raises(InputError, match=re.escape(problem)):
        named_boxes([text], KNOWN, CAMERA)


def test_prints_a_pose_and_writes_picture_and_directives(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    overlay, scene = tmp_path / "new" / "overlay.png", tmp_path / "scene"
    images = [
        "--depth",
        SCENE / "depth/000000.png",
        "--color",
        SCENE / "rgb/000000.png",
    ]
    given = ["--intrinsics", "615,615,319.5,239.5", "--models", APC11]
    boxes = ["--boxes", "up_glucose_bottle=158,177,252,337"]
    written = ["--overlay", overlay, "--directives", scene]
    budget = ["--expansions", "6", "--hypotheses", "6", "--workers", "1"]
    words = [*images, *given, *boxes, *written, *budget]
    monkeypatch.setattr(
        sys, "argv", ["physim-drake", "estimate-image", *map(str, words)]
    )
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 0
    told = capsys.readouterr().out
    assert "up_glucose_bottle: xyz [" in told
    assert told.endswith(f"{scene / 'scene.dmd.yaml'}\n")
    assert overlay.is_file()
    assert "up_glucose_bottle" in (scene / "scene.dmd.yaml").read_text()
