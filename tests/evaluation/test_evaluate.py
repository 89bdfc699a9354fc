# SPDX-License-Identifier: MIT
"""The evaluation as a whole, against an independent evaluator and by hand."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from physim_drake.camera import CameraIntrinsics, DepthImage
from physim_drake.datasets.bop import BopDataset, image_ids
from physim_drake.datasets.results import ResultRow, read_results
from physim_drake.datasets.results_writer import ResultsWriter
from physim_drake.errors import InputError
from physim_drake.evaluation.evaluate import evaluate_results
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary, ObjectModel
from physim_drake.poses import Array, SymmetryGroup, exp_pose, make_pose
from tests.datasets.tiny import write_json, write_tiny


def perturbed(
    dataset: BopDataset, angle: float, distance: float, seed: int
) -> dict[tuple[int, int], list[ResultRow]]:
    """Every true pose moved at random, about one in ten left out."""
    rng = np.random.default_rng(seed)
    rows: dict[tuple[int, int], list[ResultRow]] = {}
    for image in image_ids(dataset.targets()):
        rows[image] = []
        for pose in dataset.ground_truth(*image):
            if rng.random() < 0.1:
                continue
            xi = rng.normal(size=6) * np.repeat([angle, distance], 3)
            X_CO = pose.X_CO @ exp_pose(xi)
            rows[image].append(ResultRow(*image, pose.object_id, rng.random(), X_CO))
    return rows


def write(path: Path, rows: dict[tuple[int, int], list[ResultRow]]) -> None:
    with ResultsWriter(path) as writer:
        for index, (image, found) in enumerate(rows.items()):
            writer.write_image(*image, found, time=0.5 + index)


@pytest.fixture(scope="module")
def dataset(shared: Path) -> BopDataset:
    return BopDataset(shared / "data" / "apc11-dev")


@pytest.fixture(scope="module")
def library(dataset: BopDataset) -> ObjectLibrary:
    return ObjectLibrary.load(dataset.models)


@pytest.mark.parametrize(
    ("angle", "distance"), [(0.03, 0.005), (0.5, 0.02), (3.0, 0.1)]
)
def test_agrees_with_the_independent_evaluator(
    shared: Path,
    dataset: BopDataset,
    library: ObjectLibrary,
    tmp_path: Path,
    angle: float,
    distance: float,
) -> None:
    path, out = tmp_path / "results.csv", tmp_path / "out.json"
    write(path, perturbed(dataset, angle, distance, seed=int(100 * angle)))
    evaluator = shared / "tools" / "evaluate.py"
    subprocess.run(
        [sys.executable, evaluator, dataset.root, path, "--json", out],
        check=True,
        capture_output=True,
    )
    theirs = json.loads(out.read_text())
    ours = evaluate_results(dataset, read_results(path), library)

    by_key = {(e.scene_id, e.im_id, e.gt_index): e for e in ours.errors}
    assert len(by_key) == len(theirs["errors"])
    for row in theirs["errors"]:
        error = by_key[row["scene_id"], row["im_id"], row["gt"]]
        assert error.level == row["level"]
        assert error.found == row["found"]
        assert error.rotation_deg == pytest.approx(row["rot"], abs=0.01)
        assert error.geodesic_deg == pytest.approx(row["geo"], abs=0.01)
        assert error.translation_cm == pytest.approx(row["trans"] / 10, abs=0.01)
        assert error.accepted == row["accept"]
    for level, summary in [
        (theirs["all"], ours.overall),
        *((theirs["levels"][str(n)], s) for n, s in ours.levels.items()),
        *((theirs["objects"][str(n)], s) for n, s in ours.objects.items()),
    ]:
        assert summary.targets == level["targets"]
        assert summary.found == pytest.approx(level["found"])
        assert summary.rotation_mean_deg == pytest.approx(
            level["rot_mean_deg"], abs=0.01
        )
        assert summary.geodesic_median_deg == pytest.approx(
            level["geo_median_deg"], abs=0.01
        )
        assert summary.translation_mean_cm == pytest.approx(
            level["trans_mean_cm"], abs=0.01
        )
        assert summary.recall_5deg_1cm == pytest.approx(level["accept"])
        # Each samples the surfaces by itself.
        assert summary.add_s_recall == pytest.approx(
            level["adds"], abs=1.01 / level["targets"]
        )
    assert ours.time_per_image == pytest.approx(theirs["time_per_image_s"])
    assert (ours.images, ours.timed_images) == (
        theirs["images"],
        theirs["images_with_time"],
    )


def tiny_world(root: Path) -> tuple[BopDataset, ObjectLibrary]:
    """Object 1 twice and object 2 once in image 0 of scene 3; no models_info.json."""
    write_tiny(root)
    poses = [
        {"obj_id": n, "cam_R_m2c": [1, 0, 0, 0, 1, 0, 0, 0, 1], "cam_t_m2c": t}
        for n, t in ((1, [0, 0, 500]), (2, [80, 0, 500]), (1, [-80, 0, 500]))
    ]
    write_json(root / "test" / "000003" / "scene_gt.json", {"0": poses})
    targets = [
        {"scene_id": 3, "im_id": 0, "obj_id": 1, "inst_count": 2},
        {"scene_id": 3, "im_id": 0, "obj_id": 2, "inst_count": 1},
    ]
    write_json(root / "test_targets_bop19.json", targets)
    mesh = trimesh.creation.box((0.02, 0.03, 0.04))
    boxes = [
        ObjectModel.from_mesh(n, f"box {n}", mesh, symmetry=SymmetryGroup())
        for n in (1, 2)
    ]
    return BopDataset(root), ObjectLibrary(boxes, "memory")


def estimate(object_id: int, x: float, score: float) -> ResultRow:
    return ResultRow(3, 0, object_id, score, make_pose(p=[x, 0.0, 0.5]), 2.0)


def test_the_best_scores_are_matched_with_the_nearest_pose(tmp_path: Path) -> None:
    dataset, library = tiny_world(tmp_path)
    rows = [
        estimate(1, -0.08, 0.1),  # exact, but third by score of two instances
        estimate(1, -0.07, 0.8),
        estimate(1, 0.002, 0.9),
        estimate(7, 0.0, 1.0),
    ]
    report = evaluate_results(dataset, rows, library)
    first, second, missed = report.errors
    assert (first.gt_index, second.gt_index, missed.gt_index) == (0, 2, 1)
    assert first.translation_cm == pytest.approx(0.2)
    assert second.translation_cm == pytest.approx(1.0)
    assert (missed.found, missed.rotation_deg, missed.translation_cm) == (False, 90, 20)
    assert report.objects[2].found == 0
    assert report.overall.found == pytest.approx(2 / 3)
    assert report.unused_rows == 1
    assert report.time_per_image == 2.0
    assert report.overall.ar_vsd is None
    json.dumps(report.as_dict(), allow_nan=False)


def test_estimates_are_matched_so_that_distances_add_up_to_the_least(
    tmp_path: Path,
) -> None:
    """The true pose at 0 is nearest to the estimate that the one at -80 mm needs."""
    dataset, library = tiny_world(tmp_path)
    rows = [estimate(1, -0.03, 0.9), estimate(1, 0.04, 0.8)]
    first, second, _ = evaluate_results(dataset, rows, library).errors
    assert first.translation_cm == pytest.approx(4.0)
    assert second.translation_cm == pytest.approx(5.0)


def test_a_hidden_instance_does_not_take_the_place_of_a_visible_one(
    tmp_path: Path,
) -> None:
    dataset, library = tiny_world(tmp_path)
    target = {"scene_id": 3, "im_id": 0, "obj_id": 1, "inst_count": 1}
    write_json(tmp_path / "test_targets_bop19.json", [target])
    info = [{"visib_fract": share} for share in (0.01, 1.0, 0.8)]
    write_json(tmp_path / "test" / "000003" / "scene_gt_info.json", {"0": info})
    (error,) = evaluate_results(dataset, [estimate(1, -0.08, 0.9)], library).errors
    assert (error.gt_index, error.found) == (2, True)
    assert error.translation_cm == pytest.approx(0.0, abs=1e-9)


def test_any_visible_instance_will_do_if_the_target_asks_for_fewer(
    tmp_path: Path,
) -> None:
    dataset, library = tiny_world(tmp_path)
    target = {"scene_id": 3, "im_id": 0, "obj_id": 1, "inst_count": 1}
    write_json(tmp_path / "test_targets_bop19.json", [target])
    (error,) = evaluate_results(dataset, [estimate(1, -0.07, 0.9)], library).errors
    assert error.gt_index == 2
    assert error.translation_cm == pytest.approx(1.0)
    (missed,) = evaluate_results(dataset, [], library).errors
    assert (missed.gt_index, missed.found) == (0, False)


@pytest.mark.parametrize(
    ("case", "results", "recall"),
    [
        ("two-instances", "first.csv", 0.5),
        ("two-instances", "second.csv", 0.5),
        ("hidden-instance", "visible.csv", 1.0),
    ],
)
def test_field_cases_of_several_instances(
    shared: Path, case: str, results: str, recall: float
) -> None:
    folder = shared / "data" / "field-cases" / case
    rows = read_results(folder / results)
    report = evaluate_results(BopDataset(folder), rows, ObjectLibrary.load(APC11))
    assert report.overall.recall_5deg_1cm == recall


class FlatRenderer:
    """Draws every object as one pixel at its depth."""

    def __init__(self, intrinsics: CameraIntrinsics) -> None:
        self.intrinsics = intrinsics

    def render(self, object_id: int, X_CO: Array) -> DepthImage:
        depth = np.zeros((self.intrinsics.height, self.intrinsics.width), np.float32)
        u, v = np.round(self.intrinsics.project(X_CO[:3, 3])).astype(int)
        depth[v, u] = X_CO[2, 3]
        return depth


def test_true_poses_recall_everything(tmp_path: Path) -> None:
    dataset, library = tiny_world(tmp_path)
    rows = [estimate(1, 0.0, 1.0), estimate(1, -0.08, 0.9), estimate(2, 0.08, 1.0)]
    overall = evaluate_results(dataset, rows, library, FlatRenderer).overall
    assert overall.ar_vsd == overall.ar_mssd == overall.ar_mspd == 1
    assert overall.add_s_recall == overall.recall_5deg_1cm == 1
    assert overall.geodesic_mean_deg == overall.translation_mean_cm == 0
    overall = evaluate_results(dataset, rows[:1], library, FlatRenderer).overall
    assert overall.ar_vsd == pytest.approx(1 / 3)


def test_images_without_ground_truth_cannot_be_judged(tmp_path: Path) -> None:
    dataset, library = tiny_world(tmp_path)
    (tmp_path / "test" / "000003" / "scene_gt.json").unlink()
    with pytest.raises(InputError, match="no true pose of object 1 in scene 3"):
        evaluate_results(dataset, [], library)


def test_an_object_the_library_lacks_is_named(tmp_path: Path) -> None:
    dataset, library = tiny_world(tmp_path)
    with pytest.raises(InputError, match="no object with id 2"):
        evaluate_results(
            dataset,
            [estimate(2, 0.0, 1.0)],
            ObjectLibrary([library[1]], "memory"),
        )
