# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
import math
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np
import pytest
import torch

import physim_drake.cli.estimate_run as estimate_run
from physim_drake import batch
from physim_drake.batch import choose_images
from physim_drake.cli import main
from physim_drake.cli.estimate import MethodName
from physim_drake.datasets.bop import BopDataset, Target
from physim_drake.datasets.results import read_results
from physim_drake.detection.detector import NetworkDetector
from physim_drake.detection.networks import ObjectClass, classes_of
from physim_drake.errors import InputError
from physim_drake.estimation import Method
from physim_drake.estimation_config import LEAST_CONFIDENCE
from physim_drake.evaluation.evaluate import evaluate_results
from physim_drake.evaluation.pose_errors import pose_error
from physim_drake.models import APC11
from physim_drake.objects import ObjectLibrary
from physim_drake.observation import Detection
from tests.cli.test_detect import write_weights, write_weights_of
from tests.datasets.tiny import write_tiny

SCENE = Path(__file__).parents[2] / "examples" / "data" / "tabletop"
BOTTLE = 5

Run = Callable[..., int | str | None]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs `physim-drake estimate` and gives its exit status."""

    def call(*arguments: str | Path) -> int | str | None:
        argv = ["physim-drake", "estimate", *map(str, arguments)]
        monkeypatch.setattr(sys, "argv", argv)
        # On a slow machine there would be lines about how far it is.
        monkeypatch.setattr("physim_drake.cli.progress.LINE_EVERY", math.inf)
        with pytest.raises(SystemExit) as caught:
            main()
        return caught.value.code

    return call


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """The example's image twice, 0 and 1, with the bottle as the only target."""
    root = tmp_path / "two"
    shutil.copytree(SCENE, root)
    scene = root / "test" / "000001"
    for name in ("rgb", "depth"):
        shutil.copy(scene / name / "000000.png", scene / name / "000001.png")
    for path in sorted((scene / "mask_visib").glob("000000_*.png")):
        shutil.copy(path, path.with_name(path.name.replace("000000_", "000001_", 1)))
    for name in ("scene_camera.json", "scene_gt.json", "scene_gt_info.json"):
        edit(scene / name, lambda value: value | {"1": value["0"]})
    for name, key in (
        ("detections.json", "image_id"),
        ("test_targets_bop19.json", "im_id"),
    ):
        edit(root / name, lambda value, key=key: twice(value, key))
    return root


def twice(entries: list[dict[str, Any]], key: str) -> list[dict[str, Any]]:
    """The bottle's entries for image 0 and image 1."""
    kept = [e for e in entries if e.get("obj_id", e.get("category_id")) == BOTTLE]
    return kept + [entry | {key: 1} for entry in kept]


def edit(path: Path, change: Callable[[Any], Any]) -> None:
    """Rewrites a JSON file."""
    path.write_text(json.dumps(change(json.loads(path.read_text()))))


def quick(dataset: Path, out: Path) -> tuple[str | Path, ...]:
    """Arguments of the fastest run."""
    start = (dataset, "--out", out, "--models", APC11, "--workers", "1")
    return (*start, "--method", "super4pcs-icp", "--hypotheses", "5")


def without_time(path: Path) -> list[str]:
    return [line.rpartition(",")[0] for line in path.read_text().splitlines()]


def test_estimates_the_example(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "results.csv"
    folders = ("--overlays", tmp_path / "pictures", "--trace", tmp_path / "traces")
    budget = ("--expansions", "24", "--workers", "2")
    assert run(SCENE, "--out", out, "--models", APC11, *budget, *folders) == 0
    captured = capsys.readouterr()
    assert "3 of 3 objects found" in captured.err
    assert captured.out == ""
    data = BopDataset(SCENE)
    truth = {pose.object_id: pose.X_CO for pose in data.ground_truth(1, 0)}
    library = ObjectLibrary.load(APC11, truth)
    rows = read_results(out)
    assert sorted(row.object_id for row in rows) == sorted(truth)
    for row in rows:
        symmetry = library[row.object_id].symmetry
        error = pose_error(truth[row.object_id], row.X_CO, symmetry)
        assert error.translation < 0.005
        assert np.degrees(error.geodesic) < 3.0
        assert row.score > 0.8
        assert row.time is not None
        assert row.time > 0.5
    picture = cv2.imread(str(tmp_path / "pictures" / "000001_000000.png"))
    assert picture is not None
    assert picture.shape == (480, 1280, 3)
    trace = json.loads((tmp_path / "traces" / "000001_000000.json").read_text())
    scores = [[p["score"] for p in g["points"]] for g in trace["groups"]]
    assert all(s == sorted(s) and len(s) > 0 for s in scores)
    assert set(trace["stages"]) >= {"hypotheses", "search", "refinement"}
    assert trace["method"] == "physim-mcts"


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


def test_images_chooses_several(run: Run, dataset: Path, tmp_path: Path) -> None:
    out = tmp_path / "r.csv"
    pca = ("--method", "pca-icp")
    assert run(*quick(dataset, out), *pca, "--images", "1/1", "1/0", "--masks") == 0
    assert [row.im_id for row in read_results(out)] == [1, 0]


def test_an_object_without_points_is_not_found(
    run: Run, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def moved(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
        return [entry | {"bbox": [250, 440, 30, 30]} for entry in entries]

    edit(dataset / "detections.json", moved)
    out = tmp_path / "r.csv"
    height = ("--surface", "0")
    assert run(*quick(dataset, out), "--images", "1/0", *height) == 0
    assert read_results(out) == []
    assert "1/0 up_glucose_bottle: not found: its segment has 0" in (
        capsys.readouterr().err
    )


def test_an_object_of_less_confidence_is_not_found(
    run: Run, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "r.csv"
    strict = (*quick(dataset, out), "--least-confidence", "1")
    assert run(*strict, "--images", "1/0") == 0
    assert read_results(out) == []
    said = capsys.readouterr().err
    assert "1/0 up_glucose_bottle: not found: confidence 0." in said
    assert "is below 1.00" in said
    data, library = BopDataset(dataset), ObjectLibrary.load(APC11, [BOTTLE])
    report = evaluate_results(data, read_results(out), library)
    assert [(e.found, e.confidence) for e in report.errors] == [(False, None)] * 2
    assert report.calibration is None
    assert run(*quick(dataset, out), "--resume") == 2
    assert "least_confidence: the run began with '1'" in capsys.readouterr().err
    assert run(*quick(dataset, out), "--images", "1/0") == 0
    assert len(read_results(out)) == 1


@pytest.mark.parametrize("least", ["-0.1", "1.1", "nan"])
def test_a_required_confidence_lies_between_0_and_1(
    run: Run, dataset: Path, tmp_path: Path, least: str
) -> None:
    out = tmp_path / "r.csv"
    assert run(*quick(dataset, out), f"--least-confidence={least}") == 2
    assert not out.exists()


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
    "no detection": (drop_detection, "has no detection of object 5 in image 1/1"),
}


@pytest.mark.parametrize("name", LATE_DEFECTS)
def test_a_defect_is_one_line_and_keeps_what_is_done(
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
    assert run(*quick(dataset, out), *pca) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("error: ")
    assert captured.err.count("\n") == 1
    assert message in captured.err
    assert [row.im_id for row in read_results(out)] == [0]


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
    "name": (lambda root: None, ["--images", "first"], "'first' is no image"),
    "surface": (lambda root: None, ["--surface", "nan"], "--surface: is 'nan'"),
    "NaN": (
        camera(cam_K=[float("nan"), 0, 320, 0, 615, 240, 0, 0, 1]),
        [],
        "scene_camera.json: is not valid JSON: NaN",
    ),
    "open": (other_models(1.0, keep_faces=6), [], "cube.obj"),
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


def use_weights(monkeypatch: pytest.MonkeyPatch, detector: Path) -> None:
    """Makes these the weights that come with the package."""
    monkeypatch.setattr(batch, "DETECTOR", detector)


def test_without_detections_and_weights_one_of_them_is_asked_for(
    run: Run,
    dataset: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (dataset / "detections.json").unlink()
    use_weights(monkeypatch, tmp_path / "none")
    assert run(dataset, "--out", tmp_path / "r.csv", "--models", APC11) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "give --detections FILE" in line


def objects_of_apc11() -> tuple[ObjectClass, ...]:
    return classes_of(ObjectLibrary.load(APC11))


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    """Of a network that knows the package's objects by name only."""
    return write_weights_of(tmp_path / "own.safetensors", objects_of_apc11())


def masked(dataset: Path, *object_ids: int) -> Callable[..., tuple[Detection, ...]]:
    """What a network that sees these objects as they are says of the example."""
    true = [d for d in BopDataset(dataset).masks(1, 0) if d.object_id in object_ids]

    def detect(*arguments: object) -> tuple[Detection, ...]:
        return tuple(replace(d, score=0.9) for d in true)

    return detect


def test_without_detections_the_network_of_the_package_finds_the_objects(
    run: Run,
    dataset: Path,
    weights: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (dataset / "detections.json").unlink()
    use_weights(monkeypatch, weights)
    seen = masked(SCENE, *(c.object_id for c in objects_of_apc11()))
    monkeypatch.setattr(NetworkDetector, "detect", seen)
    out, traces = tmp_path / "r.csv", tmp_path / "traces"
    assert run(*quick(dataset, out), "--images", "1/0", "--trace", traces) == 0
    assert "1 of 1 objects found" in capsys.readouterr().err
    assert [row.object_id for row in read_results(out)] == [BOTTLE]


def test_an_object_that_the_network_does_not_see_is_not_found(
    run: Run,
    dataset: Path,
    weights: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def two_bottles(targets: list[dict[str, Any]]) -> list[dict[str, Any]]:
        return [target | {"inst_count": 2} for target in targets]

    edit(dataset / "test_targets_bop19.json", two_bottles)
    monkeypatch.setattr(NetworkDetector, "detect", masked(SCENE, BOTTLE))
    out = tmp_path / "r.csv"
    one = ("--images", "1/0", "--weights", weights)
    assert run(*quick(dataset, out), *one) == 0
    said = capsys.readouterr().err
    assert "1/0 up_glucose_bottle: not found: the detector did not see it" in said
    assert "1 of 2 objects found" in said
    assert len(read_results(out)) == 1
    monkeypatch.setattr(NetworkDetector, "detect", masked(SCENE, 1))
    assert run(*quick(dataset, out), *one) == 0
    assert "0 of 2 objects found" in capsys.readouterr().err
    assert read_results(out) == []


def test_the_method_with_segments_of_its_own_leaves_given_boxes_alone(
    run: Run,
    dataset: Path,
    weights: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    use_weights(monkeypatch, weights)
    monkeypatch.setattr(NetworkDetector, "detect", masked(SCENE, 1))
    out = tmp_path / "r.csv"
    method = ("--method", "fcn-pca-icp", "--images", "1/0")
    assert run(*quick(dataset, out), *method) == 0
    assert "not found: the detector did not see it" in capsys.readouterr().err
    monkeypatch.setattr(NetworkDetector, "detect", masked(SCENE, BOTTLE))
    assert run(*quick(dataset, out), *method) == 0
    assert [row.object_id for row in read_results(out)] == [BOTTLE]


def damaged_weights(weights: Path, defect: str) -> Path:
    """Weights that cannot be used."""
    if defect == "of other objects":
        return write_weights(weights.with_name("other"), 1, 99)
    path = weights.with_name("bad")
    if defect == "a pickle":
        torch.save({}, path)
    elif defect == "cut short":
        path.write_bytes(weights.read_bytes()[:-9])
    return path


BAD_WEIGHTS = {
    "of other objects": "are weights for other objects",
    "a pickle": "pickles are never loaded",
    "cut short": "is damaged or no safetensors file",
    "missing": "cannot be read: No such file",
}


@pytest.mark.parametrize("defect", BAD_WEIGHTS)
@pytest.mark.parametrize("method", ["pca-icp", "fcn-pca-icp"])
def test_weights_that_cannot_be_used_leave_earlier_results(
    run: Run,
    dataset: Path,
    weights: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    defect: str,
    method: str,
) -> None:
    out = tmp_path / "r.csv"
    out.write_text("earlier")
    bad = damaged_weights(weights, defect)
    arguments = ("--models", APC11, "--method", method, "--weights", bad)
    assert run(dataset, "--out", out, *arguments) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith(f"error: {bad}: ")
    assert captured.err.count("\n") == 1
    assert BAD_WEIGHTS[defect] in captured.err
    assert out.read_text() == "earlier"


def test_image_names_are_checked_against_the_targets() -> None:
    targets = [Target(1, 0, 1, 1), Target(1, 0, 2, 1), Target(2, 5, 1, 1)]
    assert choose_images(targets, []) == [(1, 0), (2, 5)]
    assert choose_images(targets, ["2/5", "2/5"]) == [(2, 5)]
    for name in ("", "1", "1/", "a/0", "1/0/2", "-1/0", "1/٣"):
        with pytest.raises(InputError, match="is no image"):
            choose_images(targets, [name])


def test_the_methods_are_those_of_the_library() -> None:
    assert list(get_args(MethodName)) == [str(method) for method in Method]


def test_ground_truth_names_the_targets_where_nothing_else_does(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = write_tiny(tmp_path / "tiny")
    (root / "test_targets_bop19.json").unlink()
    arguments = ("--masks", "--models", APC11, "--images", "3/0")
    # The tiny image has too few pixels to find anything in.
    assert run(root, "--out", tmp_path / "r.csv", *arguments) == 2
    assert "tiny/3/0" in capsys.readouterr().err


def test_the_help_says_how_much_confidence_is_required(
    run: Run, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "400")
    assert run("--help") == 0
    assert f"By default {LEAST_CONFIDENCE:g}, or 0 with --plain" in (
        " ".join(capsys.readouterr().out.split())
    )
