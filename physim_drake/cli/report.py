# SPDX-License-Identifier: MIT
"""`physim-drake report`: the paper's tables and figures for a dataset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from physim_drake.cli.options import (
    DatasetModels,
    Detections,
    EngineOption,
    Expansions,
    Hypotheses,
    LogLevel,
    Masks,
    Plain,
    Quiet,
    Resume,
    Seed,
    Split,
    TrueDataset,
    Vsd,
    Workers,
)
from physim_drake.cli.output import LogLevelName, messages
from physim_drake.errors import InputError
from physim_drake.estimation.method import Method
from physim_drake.extras import need_extra
from physim_drake.parallel.cores import default_workers
from physim_drake.parallel.engine import Engine

if TYPE_CHECKING:
    from rich.console import Console

    from physim_drake.estimation.config import EstimationConfig
    from physim_drake.reporting.detector_loss import DetectorLoss
    from physim_drake.reporting.study import HypothesisQuality, MethodRun, Study
    from physim_drake.reporting.study_notes import StudyNotes

PROGRESS_FILE = "report.progress"
"""Keeps what is found, in the report's folder."""

_METHODS = ",".join(Method)


def report(
    dataset: TrueDataset,
    out: Annotated[
        Path,
        typer.Option(metavar="DIR", help="Folder for the report.", show_default=False),
    ],
    methods: Annotated[
        str,
        typer.Option(
            metavar="A,B,...", help="The methods to compare, separated by commas."
        ),
    ] = _METHODS,
    split: Split = "test",
    models: DatasetModels = None,
    detections: Detections = None,
    masks: Masks = False,
    detector: Annotated[
        bool,
        typer.Option(
            "--detector",
            help="Also run the first method that searches on a network's detections, "
            "and show how much accuracy that costs.",
        ),
    ] = False,
    weights: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Weights of the network, for --detector and for fcn-pca-icp.",
            show_default="those of apc11",
        ),
    ] = None,
    expansions: Expansions = 250,
    plain: Plain = False,
    hypotheses: Hypotheses = 25,
    workers: Workers = None,
    seed: Seed = 0,
    vsd: Vsd = False,
    resume: Resume = False,
    engine: EngineOption = Engine.LOCAL,
    quiet: Quiet = False,
    log_level: LogLevel = LogLevelName.WARNING,
) -> None:
    """Run methods on a dataset and write the paper's tables and figures.

    The folder gets `index.html`, one page with tables by interaction level, the quality
    of the hypotheses, errors against expansions, and a gallery with the worst images
    first; the same as `report.json`; and a CSV for each table. The same seed gives the
    same report.

    What is found in an image is kept at once, in `report.progress`: a run that was cut
    off goes on with `--resume` and writes the same report.

    The method fcn-pca-icp takes its segments from a network. If the weights that come
    with the package are for other objects, and you give no others, the report says so
    and leaves the method out.

    Example: `physim-drake report datasets/apc11 --out report --methods physim-mcts`
    """
    need_extra("viz")

    from physim_drake.cli.detections import detection_source
    from physim_drake.datasets.bop import BopDataset
    from physim_drake.objects.model import ObjectLibrary
    from physim_drake.reporting.study import Study
    from physim_drake.reporting.study_notes import StudyNotes
    from physim_drake.reporting.study_page import write_report
    from physim_drake.storage.files import make_folder
    from physim_drake.storage.progress_file import ProgressFile

    names = _read_methods(methods)
    make_folder(out)
    data = BopDataset(dataset, split, models)
    wanted = data.targets()
    library = ObjectLibrary.load(data.models, {t.object_id for t in wanted})
    source = detection_source(data, detections, masks, targets=wanted)
    config = _config(seed, plain, workers, expansions, hypotheses)
    study = Study(data, library, source.look_up, source.name, config, engine=engine)
    plan, notes = _plan(study, names, detector, weights, methods == _METHODS)
    settings = {
        "dataset": str(dataset.resolve()),
        "split": split,
        "models": str(data.models.resolve()),
        "detections": source.name,
        "methods": ", ".join(item.described(source.name) for item in plan),
        "expansions": str(expansions),
        "hypotheses": str(hypotheses),
        "seed": str(seed),
        "plain": str(plain),
    }
    with ProgressFile(out / PROGRESS_FILE, settings, out) as progress:
        found = StudyNotes(progress, progress.go_on(resume))
        runs, quality = _run(study, plan, found, vsd, messages(quiet))
    for note in notes:
        typer.echo(note, err=True)
    losses = _losses(plan, runs)
    typer.echo(write_report(study, runs, quality, out, losses=losses, notes=notes))


@dataclass(frozen=True)
class _Item:
    """A method to run, what with, and what to call it."""

    method: Method
    study: Study
    name: str

    def described(self, source: str) -> str:
        """Its name, and its detections if they are not those of `source`."""
        own = self.study.source
        return self.name if own == source else f"{self.name} with {own}"


def _run(
    study: Study, plan: Sequence[_Item], found: StudyNotes, vsd: bool, console: Console
) -> tuple[list[MethodRun], HypothesisQuality]:
    """Does what is planned and not found yet."""
    from physim_drake.cli.progress import Steps
    from physim_drake.rendering.depth import DepthRenderer

    total = len(study.images) * (len(plan) + 1)
    renderer = (lambda K: DepthRenderer(study.library, K)) if vsd else None
    with Steps(console, "image", total) as steps:
        steps.begin(len(found))

        def noted(study: Study) -> Study:
            return replace(study, progress=steps.advance, notes=found)

        quality = noted(study).hypothesis_quality()
        runs = [
            noted(item.study).run(item.method, renderer, item.name) for item in plan
        ]
    return runs, quality


def _losses(
    plan: Sequence[_Item], runs: Sequence[MethodRun]
) -> dict[str, DetectorLoss]:
    """What a network's detections cost, by the name of the run with them."""
    from physim_drake.reporting.detector_loss import detector_loss

    by_name = {run.name: run.report.errors for run in runs}
    return {
        item.name: detector_loss(by_name[item.method], by_name[item.name])
        for item in plan
        if item.name != item.method
    }


def _plan(
    study: Study,
    methods: Sequence[Method],
    detector: bool,
    weights: Path | None,
    by_default: bool,
) -> tuple[list[_Item], list[str]]:
    """What to run, and why a method that was not asked for by name is left out."""
    from physim_drake.batch.detection_source import DetectionSource

    plan, notes = [], []
    for method in methods:
        own = study
        if method is Method.FCN_PCA_ICP:
            try:
                found = DetectionSource.network(study.dataset, weights, pixels=True)
            except InputError as error:
                if not by_default or weights is not None:
                    raise
                notes.append(f"{method} is missing: {error}")
                continue
            own = replace(study, look_up=found.look_up, source=found.name)
        plan.append(_Item(method, own, str(method)))
    if detector:
        searching = next((m for m in methods if m.searches), None)
        if searching is None:
            raise InputError(
                "--detector", "needs a method that searches", "add physim-mcts"
            )
        found = DetectionSource.network(study.dataset, weights)
        own = replace(study, look_up=found.look_up, source=found.name)
        plan.append(_Item(searching, own, f"{searching}, detector"))
    return plan, notes


def _read_methods(text: str) -> list[Method]:
    names = list(dict.fromkeys(n.strip() for n in text.split(",") if n.strip()))
    remedy = f"choose from {', '.join(Method)}"
    for name in names:
        if name not in set(Method):
            raise InputError("--methods", f"{name!r} is not a method", remedy)
    if not names:
        raise InputError("--methods", "names no method", remedy)
    return [Method(name) for name in names]


def _config(
    seed: int, plain: bool, workers: int | None, expansions: int, hypotheses: int
) -> EstimationConfig:
    from physim_drake.estimation.config import EstimationConfig

    config = EstimationConfig.paper() if plain else EstimationConfig()
    config = config.with_budget(expansions, hypotheses)
    return replace(config, seed=seed, workers=workers or default_workers())
