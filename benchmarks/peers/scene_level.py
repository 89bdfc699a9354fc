# SPDX-License-Identifier: MIT
"""Whole scenes: what each object's best registration gives, against `estimate`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks.peers.cases import Case, PartOfDataset, clocked
from benchmarks.peers.registration import Registration
from benchmarks.peers.tables import Row, ratio
from physim_drake.batch.detection_source import DetectionLookup
from physim_drake.datasets.bop import ImageId
from physim_drake.datasets.results import ResultRow
from physim_drake.estimation.estimator import EstimationConfig
from physim_drake.evaluation.evaluate import evaluate_results
from physim_drake.evaluation.report import EvaluationReport
from physim_drake.objects.model import ObjectLibrary
from physim_drake.reporting.study import Study


def scene_rows(
    dataset: PartOfDataset,
    library: ObjectLibrary,
    detections: tuple[DetectionLookup, str],
    cases: Mapping[ImageId, Sequence[Case]],
    methods: Sequence[Registration],
    progress: Callable[[str], None],
) -> list[Row]:
    """One row a method: `estimate` first, then each registration with its refiner.

    Errors are means over all objects, 90 degrees and 20 cm for one that is missing;
    VSD is left out. Ratios are to `estimate`.
    """
    progress("estimate")
    config = EstimationConfig()
    study = Study(dataset, library, *detections, config)
    run = study.run(config.method, None)
    rows = [_row("physim-drake estimate", run.report)]
    for method in methods:
        progress(method.name)
        results = [
            row
            for image, of_image in cases.items()
            for row in _results(method, image, of_image)
        ]
        name = f"{method.name}, each alone + {method.refiner.name}"
        rows.append(_row(name, evaluate_results(dataset, results, library)))
    for row in rows:
        for key in ("deg", "cm"):
            row[f"{key}, ratio"] = ratio(row[key], rows[0][key])
    return rows


def _results(
    method: Registration, image: ImageId, cases: Sequence[Case]
) -> list[ResultRow]:
    found, total = [], 0.0
    for case in cases:
        prepared = method.prepare(case.model)
        refining = method.refiner.prepare(case.model)
        poses, seconds = clocked(method.propose, prepared, case, 0)
        total += seconds
        if len(poses):
            X_SO, seconds = clocked(method.refiner.refine, refining, case, poses[0])
            total += seconds
            found.append((case, X_SO))
    return [
        ResultRow(*image, c.model.object_id, 1.0, c.scene.X_CS @ X, total)
        for c, X in found
        if np.isfinite(X).all()
    ]


def _row(name: str, report: EvaluationReport) -> Row:
    return {
        "method": name,
        "n": report.overall.targets,
        "deg": report.overall.rotation_mean_deg,
        "cm": report.overall.translation_mean_cm,
        "5 deg 1 cm %": 100 * report.overall.recall_5deg_1cm,
        "s an image": report.time_per_image,
    }
