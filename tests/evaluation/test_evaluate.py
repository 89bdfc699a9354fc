# SPDX-License-Identifier: MIT
"""The evaluation as a whole, against an independent evaluator and by hand."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from physim_drake.datasets.bop import BopDataset, image_ids
from physim_drake.datasets.results import ResultRow, read_results
from physim_drake.datasets.results_writer import ResultsWriter
from physim_drake.errors import InputError
from physim_drake.evaluation.evaluate import evaluate_results
from physim_drake.objects import ObjectLibrary
from physim_drake.poses import exp_pose


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
