# SPDX-License-Identifier: MIT
"""`physim-drake evaluate`: judge a results file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from physim_drake.cli.options import (
    DatasetModels,
    JsonFile,
    LogLevel,
    Quiet,
    Split,
    TrueDataset,
    Vsd,
)
from physim_drake.cli.output import LogLevelName, counted, messages, output_json

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.table import Table

    from physim_drake.evaluation.report import EvaluationReport, Summary


def evaluate(
    results: Annotated[
        Path,
        typer.Argument(
            help="File of poses in BOP's results format (CSV), as estimate writes it.",
            show_default=False,
        ),
    ],
    dataset: TrueDataset,
    json_file: JsonFile = None,
    models: DatasetModels = None,
    split: Split = "test",
    vsd: Vsd = True,
    quiet: Quiet = False,
    log_level: LogLevel = LogLevelName.WARNING,
) -> None:
    """Judge results against a dataset's ground truth.

    Prints, by interaction level and by object: how many targets there are (n) and the
    fraction found; the mean of |roll|, |pitch|, |yaw| (rot.), mean and median rotation
    angle, mean and median distance; the fraction within 5 degrees and 1 cm, and with an
    ADD-S below a tenth of the diameter; the average recalls (AR) of the BOP challenge.
    Errors are the smallest over an object's symmetries; a target that was not found
    counts as 90 degrees and 20 cm. `--json` has the errors of every target.

    Example: `physim-drake evaluate results.csv datasets/apc11 --json report.json`
    """
    from rich.console import Console

    from physim_drake.cli.progress import Steps
    from physim_drake.datasets.bop import BopDataset
    from physim_drake.datasets.results import read_results
    from physim_drake.evaluation.evaluate import evaluate_results
    from physim_drake.objects.model import ObjectLibrary
    from physim_drake.rendering.depth import DepthRenderer
    from physim_drake.storage.files import check_writable

    if json_file is not None and str(json_file) != "-":
        check_writable(json_file)
    data = BopDataset(dataset, split, models)
    rows = read_results(results)
    targets = data.targets()
    library = ObjectLibrary.load(data.models, {t.object_id for t in targets})
    with Steps(messages(quiet), "target", len(targets)) as steps:
        report = evaluate_results(
            data,
            rows,
            library,
            (lambda intrinsics: DepthRenderer(library, intrinsics)) if vsd else None,
            steps.reach,
        )
    if json_file is not None and output_json(json_file, report.as_dict()):
        return
    console = Console(highlight=False)
    if not console.is_terminal:
        # A file or pipe has no width; rich would take 80 and cut the table.
        console.width = 160
    console.print(
        _table(report, {model.object_id: model.name for model in library.values()})
    )
    console.print(_footer(report))
    if report.calibration is not None:
        console.print(str(report.calibration))


def _table(report: EvaluationReport, names: Mapping[int, str]) -> Table:
    from rich import box
    from rich.table import Table

    # Narrow enough that a terminal of 80 columns shows all of it.
    table = Table(box=box.SIMPLE_HEAD, padding=0, pad_edge=False)
    table.add_column("", overflow="fold", min_width=10)
    for header in (
        "n",
        "found",
        "rot.\ndeg",
        "angle\ndeg",
        "med.\ndeg",
        "dist.\ncm",
        "med.\ncm",
        "5 deg\n1 cm",
        "ADD-S\n0.1 d",
        "AR\nVSD",
        "AR\nMSSD",
        "AR\nMSPD",
    ):
        table.add_column(header, justify="right", no_wrap=True)
    for level, summary in report.levels.items():
        table.add_row(f"level {level}", *_cells(summary))
    table.add_row("all", *_cells(report.overall), style="bold")
    table.add_section()
    for object_id, summary in report.objects.items():
        table.add_row(names[object_id], *_cells(summary))
    return table


def _cells(summary: Summary) -> list[str]:
    s = summary
    return [
        str(s.targets),
        f"{s.found:.3f}",
        f"{s.rotation_mean_deg:.2f}",
        f"{s.geodesic_mean_deg:.2f}",
        f"{s.geodesic_median_deg:.2f}",
        f"{s.translation_mean_cm:.2f}",
        f"{s.translation_median_cm:.2f}",
        f"{s.recall_5deg_1cm:.3f}",
        f"{s.add_s_recall:.3f}",
        "-" if s.ar_vsd is None else f"{s.ar_vsd:.3f}",
        f"{s.ar_mssd:.3f}",
        f"{s.ar_mspd:.3f}",
    ]


def _footer(report: EvaluationReport) -> str:
    if report.time_per_image is None:
        text = f"{counted(report.images, 'image')}, no times given"
    else:
        text = f"{report.time_per_image:.2f} s an image"
        text += f" ({report.timed_images} of {counted(report.images, 'image')})"
    if report.unused_rows:
        text += f"; {counted(report.unused_rows, 'row')} without a target"
    return text
