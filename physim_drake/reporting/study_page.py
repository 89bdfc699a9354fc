# SPDX-License-Identifier: MIT
"""A study's figures as one self-contained HTML page, JSON and CSV."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from physim_drake.datasets.bop import ImageId
from physim_drake.evaluation.calibration import SURE, reliability_figure
from physim_drake.evaluation.report import InstanceErrors, Summary
from physim_drake.poses import Array
from physim_drake.rendering.overlay import draw_overlay
from physim_drake.reporting.detector_loss import DetectorLoss
from physim_drake.reporting.html import jpeg, png, render_page
from physim_drake.reporting.study import (
    SUCCESS_CM,
    SUCCESS_DEG,
    HypothesisQuality,
    MethodRun,
    Study,
)
from physim_drake.storage.files import write_atomically

_LEVEL_NAMES = {1: "one object", 2: "two objects", 3: "three objects"}


@dataclass(frozen=True)
class _Picture:
    image: str
    caption: str


def write_report(
    study: Study,
    runs: Sequence[MethodRun],
    quality: HypothesisQuality | None,
    folder: Path,
    gallery: int = 24,
    *,
    losses: Mapping[str, DetectorLoss] | None = None,
    notes: Sequence[str] = (),
) -> Path:
    """Writes `index.html`, `report.json` and a CSV for each table into a folder.

    Args:
        study: the study.
        runs: runs of its methods; the gallery shows the first that searched.
        quality: quality of the hypotheses, if it was measured.
        folder: folder of the files; it is made if missing.
        gallery: number of images in the gallery.
        losses: loss by the name of a run with a network's detections.
        notes: sentences below the first table.

    Returns:
        path of the page.

    Raises:
        InputError: if the folder cannot be written.
    """
    levels = sorted({level for run in runs for level in run.report.levels})
    names = [*(_LEVEL_NAMES.get(n, f"level {n}") for n in levels), "all"]
    losses = losses or {}
    rows = [_table_row(run, levels, losses.get(run.name)) for run in runs]
    shown = next((run for run in runs if len(run.curve)), runs[0])
    page = render_page(
        "page.html.j2",
        title=f"Pose estimation on {study.dataset.root.resolve().name}",
        images=len(study.images),
        targets=runs[0].report.overall.targets,
        seed=study.config.seed,
        expansions=study.config.search.expansions,
        representatives=study.config.steps.hypotheses.clustering.representatives,
        levels=names,
        table_one=rows,
        losses=bool(losses),
        notes=notes,
        table_two=quality,
        success_deg=SUCCESS_DEG,
        success_cm=SUCCESS_CM,
        curves=_curve_pictures(runs),
        reliability=_reliability(shown),
        gallery=_gallery(study, shown, gallery),
        gallery_method=shown.name,
    )
    with write_atomically(folder / "report.json") as file:
        figures = _as_dict(study, runs, quality)
        figures["detector"] = {name: asdict(loss) for name, loss in losses.items()}
        figures["notes"] = list(notes)
        json.dump(figures, file, indent=1, allow_nan=False)
        file.write("\n")
    _write_tables(folder, names, rows, runs, quality)
    # Last, so that if there is a page, the report is complete.
    path = folder / "index.html"
    with write_atomically(path) as file:
        file.write(page)
    return path


def _table_row(
    run: MethodRun, levels: Sequence[int], loss: DetectorLoss | None
) -> dict[str, Any]:
    """A row of Table I: (rotation in degrees, translation in cm) by level, and all."""
    report = run.report
    missing = (float("nan"), float("nan"))
    cells = [_cell(report.levels[n]) if n in report.levels else missing for n in levels]
    return {
        "method": run.name,
        "loss": loss,
        "cells": [*cells, _cell(report.overall)],
        "recall": report.overall.recall_5deg_1cm,
        "found": report.overall.found,
    }


def _cell(summary: Summary) -> tuple[float, float]:
    return summary.rotation_mean_deg, summary.translation_mean_cm


def _as_dict(
    study: Study, runs: Sequence[MethodRun], quality: HypothesisQuality | None
) -> dict[str, Any]:
    methods = {}
    for run in runs:
        entry = run.report.as_dict()
        # Times differ between runs, but the same seed must give the same report.
        entry.pop("time_per_image", None)
        entry.pop("timed_images", None)
        methods[run.name] = entry | {"curve": run.curve.tolist()}
    return {
        "dataset": study.dataset.root.resolve().name,
        "seed": study.config.seed,
        "methods": methods,
        "hypotheses": None if quality is None else asdict(quality),
    }


def _write_tables(
    folder: Path,
    names: Sequence[str],
    rows: Sequence[dict[str, Any]],
    runs: Sequence[MethodRun],
    quality: HypothesisQuality | None,
) -> None:
    header = ["method"]
    for name in names:
        header += [f"{name} rotation_deg", f"{name} translation_cm"]
    _write_csv(
        folder / "table1.csv",
        [*header, "recall_5deg_1cm", "found"],
        [
            [row["method"], *sum(row["cells"], ()), row["recall"], row["found"]]
            for row in rows
        ],
    )
    if quality is not None:
        _write_csv(
            folder / "table2.csv",
            ["selected by", "rotation_deg", "translation_cm"],
            [[r.metric, r.rotation_deg, r.translation_cm] for r in quality.rows],
        )
    _write_csv(
        folder / "curves.csv",
        ["method", "expansions", "rotation_deg", "translation_cm"],
        [[run.name, *point] for run in runs for point in run.curve.tolist()],
    )
    errors = [(run.name, asdict(e)) for run in runs for e in run.report.errors]
    _write_csv(
        folder / "errors.csv",
        ["method", *(errors[0][1] if errors else ())],
        [[method, *entry.values()] for method, entry in errors],
    )


def _write_csv(
    path: Path, header: Sequence[str], rows: Sequence[Sequence[Any]]
) -> None:
    with write_atomically(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        for row in rows:
            writer.writerow([f"{v:.6g}" if isinstance(v, float) else v for v in row])


def _curve_pictures(runs: Sequence[MethodRun]) -> list[dict[str, str]]:
    curves: dict[str, Array] = {r.name: r.curve for r in runs if len(r.curve)}
    if not curves:
        return []
    pictures = []
    quantities = ((1, "rotation", "degrees"), (2, "translation", "cm"))
    for column, quantity, unit in quantities:
        figure = Figure(figsize=(7, 3.6), layout="constrained")
        axes = figure.add_subplot()
        for name, curve in curves.items():
            axes.plot(curve[:, 0], curve[:, column], label=name)
        axes.set_xlabel("expansions")
        axes.set_ylabel(f"mean {quantity} error, {unit}")
        axes.set_ylim(bottom=0)
        axes.grid(alpha=0.3)
        axes.legend()
        caption = f"Mean {quantity} error against expansions"
        pictures.append({"png": png(figure), "caption": caption})
    return pictures


def _reliability(run: MethodRun) -> dict[str, str] | None:
    calibration = run.report.calibration
    if calibration is None:
        return None
    picture = png(reliability_figure(calibration))
    text = f"Of {calibration.sure} estimates that claim {SURE:g} or more, "
    if calibration.sure_correct is None:
        text = f"No estimate claims {SURE:g} or more. "
    else:
        text += (
            f"{100 * calibration.sure_correct:.1f} % are within 5 degrees and 1 cm. "
        )
    text += "Above each bar stands how many estimates it counts."
    return {"png": picture, "text": text}


def _gallery(study: Study, run: MethodRun, count: int) -> list[_Picture]:
    by_image: dict[ImageId, list[InstanceErrors]] = {}
    for error in run.report.errors:
        by_image.setdefault((error.scene_id, error.im_id), []).append(error)
    worst_first = sorted(
        by_image, key=lambda image: -max(_badness(e) for e in by_image[image])
    )
    return [
        _Picture(_overlay(study, run, image), _caption(study, image, by_image[image]))
        for image in worst_first[:count]
    ]


def _badness(error: InstanceErrors) -> float:
    """Errors in units of 5 degrees and 1 cm, together."""
    return error.rotation_deg / 5 + error.translation_cm


def _overlay(study: Study, run: MethodRun, image: ImageId) -> str:
    observation = study.dataset.observation(*image)
    picture = draw_overlay(observation, run.estimates[image], study.library)
    return jpeg(picture, 0.6)


def _caption(study: Study, image: ImageId, errors: Sequence[InstanceErrors]) -> str:
    parts = [
        f"{study.library[e.object_id].name} {e.rotation_deg:.2f} deg, "
        f"{e.translation_cm:.2f} cm"
        if e.found
        else f"{study.library[e.object_id].name} not found"
        for e in errors
    ]
    return f"{image[0]}/{image[1]}: " + "; ".join(parts)
