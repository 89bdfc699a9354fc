# SPDX-License-Identifier: MIT
"""What is kept of a run that was cut off, or whose input has a defect."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import physim_drake.cli.estimate_run as estimate_run
from physim_drake.datasets.results import read_results
from physim_drake.models import APC11
from tests.cli.estimating import (
    SCENE,
    Run,
    edit,
    quick,
    without_time,
)


def test_resume_gives_what_an_uncut_run_gives(
    run: Run, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, cut = tmp_path / "whole.csv", tmp_path / "cut.csv"
    assert run(*quick(dataset, whole)) == 0
    with monkeypatch.context() as patch:
        interrupt_second_image(patch)
        assert run(*quick(dataset, cut)) == 130
    assert [row.im_id for row in read_results(cut)] == [0]
    with cut.open("a") as file:
        file.write("1,1,5,0.9,1 0 0")  # a torn line
    assert run(*quick(dataset, cut), "--resume") == 0
    assert without_time(cut) == without_time(whole)
    assert [row.im_id for row in read_results(cut)] == [0, 1]


def interrupt_second_image(patch: pytest.MonkeyPatch) -> None:
    original = estimate_run.estimate_images

    def cut_off(*arguments: Any) -> Any:
        yield next(original(*arguments))
        raise KeyboardInterrupt

    patch.setattr(estimate_run, "estimate_images", cut_off)


def test_resume_refuses_other_settings(
    run: Run, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "r.csv"
    assert run(*quick(dataset, out), "--images", "1/0") == 0
    before = out.read_text()
    assert run(*quick(dataset, out), "--resume", "--seed", "7") == 2
    assert "seed: the run began with '0'" in capsys.readouterr().err
    assert out.read_text() == before


def corrupt(name: str, change: Callable[[bytes], bytes | None]) -> Callable[..., None]:
    """Changes, or with None removes, a file of the dataset's scene."""

    def apply(root: Path) -> None:
        path = root / "test" / "000001" / name
        data = change(path.read_bytes())
        path.unlink() if data is None else path.write_bytes(data)

    return apply


def encoded(image: np.ndarray) -> bytes:
    return bytes(cv2.imencode(".png", image)[1].tobytes())


def camera(**changes: Any) -> Callable[..., None]:
    """Changes the second image's entry of scene_camera.json."""

    def apply(root: Path) -> None:
        path = root / "test" / "000001" / "scene_camera.json"
        edit(path, lambda value: value | {"1": value["1"] | changes})

    return apply


def drop_detection(root: Path) -> None:
    edit(root / "detections.json", lambda entries: entries[:1])


DEPTH = "depth/000001.png"
LATE_DEFECTS: dict[str, tuple[Callable[[Path], None], str]] = {
    "missing": (corrupt(DEPTH, lambda _: None), "000001.png: cannot be read"),
    "truncated": (corrupt(DEPTH, lambda d: d[:-400]), "000001.png: is a PNG cut short"),
    "no colour": (corrupt("rgb/000001.png", lambda _: None), "rgb/000001.png"),
    "8 bit": (
        corrupt(DEPTH, lambda _: encoded(np.ones((480, 640), np.uint8))),
        "000001.png: is uint8",
    ),
    "zero": (
        corrupt(DEPTH, lambda _: encoded(np.zeros((480, 640), np.uint16))),
        "000001.png: is zero everywhere",
    ),
    "intrinsics": (
        camera(cam_K=[615, 0, 2000, 0, 615, 240, 0, 0, 1]),
        "scene_camera.json: intrinsics",
    ),
    "rotation": (camera(cam_R_w2c=[1, 0, 0, 0, 1, 0, 0, 0, 2]), "cam_R_w2c"),
}


@pytest.mark.parametrize("name", LATE_DEFECTS)
def test_a_defect_of_an_image_is_one_line_and_the_others_are_done(
    run: Run,
    dataset: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
) -> None:
    change, message = LATE_DEFECTS[name]
    change(dataset)
    out = tmp_path / "r.csv"
    pca = ("--method", "pca-icp")
    assert run(*quick(dataset, out), *pca) == 3
    captured = capsys.readouterr()
    (line,) = [x for x in captured.err.splitlines() if ": failed: " in x]
    assert line.startswith("1/1: failed: ")
    assert message in line
    assert [row.im_id for row in read_results(out)] == [0]


def test_an_object_that_was_not_detected_is_not_found(
    run: Run, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drop_detection(dataset)
    out = tmp_path / "r.csv"
    assert run(*quick(dataset, out), "--method", "pca-icp") == 0
    assert "not found: the detector did not see it" in capsys.readouterr().err
    assert [row.im_id for row in read_results(out)] == [0]


def test_resume_tries_a_failed_image_again(
    run: Run, dataset: Path, tmp_path: Path
) -> None:
    depth = dataset / "test" / "000001" / DEPTH
    whole = depth.read_bytes()
    depth.write_bytes(encoded(np.zeros((480, 640), np.uint16)))
    arguments = (*quick(dataset, tmp_path / "r.csv"), "--method", "pca-icp")
    assert run(*arguments) == 3
    depth.write_bytes(whole)
    assert run(*arguments, "--resume") == 0
    assert [row.im_id for row in read_results(tmp_path / "r.csv")] == [0, 1]


def other_models(scale: float, keep_faces: int = 12) -> Callable[..., None]:
    """A models folder with one cube of 0.1 m times `scale`, as object 1."""

    def apply(root: Path) -> None:
        import trimesh

        cube = trimesh.creation.box([0.1 * scale] * 3)
        faces = [f"f {a} {b} {c}" for a, b, c in cube.faces[:keep_faces] + 1]
        vertices = [f"v {x} {y} {z}" for x, y, z in cube.vertices]
        (root / "models").mkdir()
        (root / "models" / "cube.obj").write_text("\n".join(vertices + faces))
        edit(
            root / "test_targets_bop19.json",
            lambda targets: [target | {"obj_id": 1} for target in targets],
        )

    return apply


def broken_json(root: Path) -> None:
    (root / "detections.json").write_text('[{"scene_id": 1,')


EARLY_DEFECTS: dict[str, tuple[Callable[[Path], None], list[str], str]] = {
    "no model": (
        other_models(1.0),
        ["--targets", str(SCENE / "test_targets_bop19.json")],
        "has no object with id",
    ),
    "kilometres": (other_models(1e3), [], "cube.obj"),
    "micrometres": (other_models(1e-4), [], "cube.obj"),
    "JSON": (broken_json, ["--models", str(APC11)], "detections.json: is not valid"),
    "segments of its own": (
        lambda root: None,
        ["--models", str(APC11), "--method", "fcn-pca-icp", "--masks"],
        "--masks: given with fcn-pca-icp, which segments images by a network",
    ),
    "both": (
        lambda root: None,
        ["--models", str(APC11), "--masks", "--detections", "d.json"],
        "given together with --masks",
    ),
    "image": (lambda root: None, ["--images", "1/9"], "--images: 1/9 has no target"),
    "name": (lambda root: None, ["--images", "first"], "'first' is not an image"),
    "surface": (lambda root: None, ["--surface", "nan"], "--surface: is 'nan'"),
    "NaN": (
        camera(cam_K=[float("nan"), 0, 320, 0, 615, 240, 0, 0, 1]),
        [],
        "scene_camera.json: is not valid JSON: NaN",
    ),
    "empty": (other_models(1.0, keep_faces=0), [], "cube.obj"),
}


@pytest.mark.parametrize("name", EARLY_DEFECTS)
def test_a_defect_of_the_whole_leaves_earlier_results(
    run: Run,
    dataset: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
) -> None:
    change, arguments, message = EARLY_DEFECTS[name]
    change(dataset)
    out = tmp_path / "r.csv"
    out.write_text("earlier")
    assert run(dataset, "--out", out, *arguments) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("error: ")
    assert captured.err.count("\n") == 1
    assert message in captured.err
    assert out.read_text() == "earlier"
