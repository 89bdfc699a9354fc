# SPDX-License-Identifier: MIT
"""`physim-drake report`: the paper's tables and figures for a dataset."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

_METHODS = "physim-mcts,physim-heuristic,super4pcs-icp,pca-icp"


def report(
    dataset: Annotated[
        Path,
        typer.Argument(
            help="Dataset in BOP layout, with ground truth.", show_default=False
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(metavar="DIR", help="Where the report goes.", show_default=False),
    ],
    methods: Annotated[
        str, typer.Option(metavar="A,B,...", help="Methods to compare.")
    ] = _METHODS,
    split: Annotated[str, typer.Option(help="Folder of the images.")] = "test",
    models: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Object models; by default the dataset's."),
    ] = None,
    detections: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Detections; by default the dataset's detections.json."
        ),
    ] = None,
    masks: Annotated[
        bool, typer.Option("--masks", help="Take the visible masks as detections.")
    ] = False,
    expansions: Annotated[int, typer.Option(min=1, help="Expansions a group.")] = 250,
    hypotheses: Annotated[
        int, typer.Option(min=1, help="Representatives an object.")
    ] = 25,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes; by default, one a core.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of all random choices.")] = 0,
    vsd: Annotated[
        bool, typer.Option(help="Compute VSD, for which every pose is rendered.")
    ] = False,
) -> None:
    """Run methods on a dataset and write the paper's tables and figures.

    The folder gets `index.html`, one page with tables by interaction level, the quality
    of the hypotheses, errors against expansions, and a gallery with the worst images
    first; the same as `report.json`; and a CSV for each table. The same seed gives the
    same report.

    Example: `physim-drake report datasets/apc11 --out report --methods physim-mcts`
    """
    from rich.console import Console
    from rich.progress import Progress

    from physim_drake.batch import detection_lookup
    from physim_drake.cli.estimate import default_workers
    from physim_drake.datasets.bop import BopDataset
    from physim_drake.errors import InputError
    from physim_drake.estimation import EstimationConfig, Method
    from physim_drake.files import make_folder
    from physim_drake.objects import ObjectLibrary
    from physim_drake.rendering.depth import DepthRenderer
    from physim_drake.reporting.page import write_report
    from physim_drake.reporting.study import Study

    names = [name.strip() for name in methods.split(",") if name.strip()]
    for name in names:
        if name not in set(Method):
            raise InputError(
                "--methods", f"{name!r} is none", f"choose from {', '.join(Method)}"
            )
    make_folder(out)
    data = BopDataset(dataset, split, models)
    library = ObjectLibrary.load(data.models, {t.object_id for t in data.targets()})
    look_up, source = detection_lookup(data, detections, masks)
    config = EstimationConfig(seed=seed, workers=workers or default_workers())
    config = config.with_budget(expansions, hypotheses)
    with Progress(console=Console(stderr=True)) as bar:
        images = len({(t.scene_id, t.im_id) for t in data.targets()})
        task = bar.add_task("", total=images * (len(names) + 1))

        def progress(what: str) -> None:
            bar.update(task, advance=1, description=what)

        study = Study(data, library, look_up, source, config, progress)
        renderer = (lambda K: DepthRenderer(library, K)) if vsd else None
        quality = study.hypothesis_quality()
        runs = [study.run(Method(name), renderer) for name in names]
    typer.echo(write_report(study, runs, quality, out))
