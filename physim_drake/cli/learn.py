# SPDX-License-Identifier: MIT
"""`physim-drake learn`: let the robot label what its detector missed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from physim_drake.cli.options import (
    LeastScore,
    LogLevel,
    NetworkWeights,
    NewDataset,
    Quiet,
    Seed,
    Threads,
    Workers,
)
from physim_drake.cli.output import LogLevelName, counted, messages
from physim_drake.extras import need_extra
from physim_drake.models import APC11, DETECTOR
from physim_drake.parallel.cores import default_workers


def learn(
    out: NewDataset,
    weights: NetworkWeights = DETECTOR,
    scenario: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="YAML file of the cell and its objects, as for pick.",
            show_default="all of apc11 on the table",
        ),
    ] = None,
    conditions: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="YAML file of the lights and of the camera.",
            show_default="the cell's",
        ),
    ] = None,
    scenes: Annotated[
        int, typer.Option(min=1, help="Number of scenes to look at.")
    ] = 40,
    views: Annotated[
        int, typer.Option(min=2, help="Number of views of each scene.")
    ] = 5,
    least_score: LeastScore = 0.3,
    workers: Workers = None,
    threads: Threads = None,
    seed: Seed = 0,
    quiet: Quiet = False,
    log_level: LogLevel = LogLevelName.WARNING,
) -> None:
    """Look at scenes with the robot's camera, and label what the detector missed.

    The simulated robot looks at each scene from several sides. Poses that two or more
    views agree on are certain. Drawn into all views, they label what the detector
    missed. OUT gets the labelled views, in BOP layout, for
    `train --data OUT --start WEIGHTS`.

    Example: `physim-drake learn out/learnt --conditions examples/lighting/dim.yaml`
    """
    need_extra("train")

    from physim_drake.cli.progress import Steps
    from physim_drake.detection.detector import NetworkDetector
    from physim_drake.observation.detection_selection import ChoiceConfig
    from physim_drake.picking.look_postures import LookingConditions
    from physim_drake.picking.scenario import (
        ObjectsConfig,
        PickScenario,
        load_scenario,
    )
    from physim_drake.self_learning.exploration import (
        ExplorationConfig,
        Explorer,
        explore_scenes,
    )
    from physim_drake.self_learning.labels import LabelledScene
    from physim_drake.storage.typed_yaml import load_typed_yaml
    from physim_drake.systems.detector import TrainedDetector

    cell = PickScenario(objects=ObjectsConfig(library=str(APC11)))
    if scenario is not None:
        cell = load_scenario(scenario)
    how = LookingConditions()
    if conditions is not None:
        how = load_typed_yaml(conditions, LookingConditions)
    detector = NetworkDetector.load(weights, threads)
    config = ExplorationConfig(views, workers or default_workers(), seed)
    steps = Steps(messages(quiet), "scene", scenes)
    with Explorer(cell, how, config) as explorer, steps:
        names = {i: model.name for i, model in explorer.library.items()}
        detector.check_objects(names, explorer.library.source)

        def show(number: int, scene: LabelledScene) -> None:
            steps.reach(number + 1)

        algorithm = TrainedDetector(
            detector, dict.fromkeys(explorer.library, 1), ChoiceConfig(least_score)
        )
        figures = explore_scenes(explorer, algorithm, out, scenes, show)
    typer.echo(
        f"{out}: {counted(figures['images'], 'image')} with "
        f"{counted(figures['labels'], 'label')}, "
        f"{figures['missed']} of objects that the detector had missed"
    )
