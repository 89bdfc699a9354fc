# SPDX-License-Identifier: MIT
"""Arguments and options that commands share.

An option without a default value of its own says in `show_default` what is done then.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from physim_drake.cli.output import LogLevelName, set_log_level
from physim_drake.errors import InputError
from physim_drake.objects.container_name import ContainerName
from physim_drake.parallel.cores import MAX_DEFAULT_WORKERS
from physim_drake.parallel.engine import Engine

# Data.

Dataset = Annotated[
    Path,
    typer.Argument(
        help="Dataset in BOP layout: DATASET/SPLIT/SCENE/{rgb,depth,"
        "scene_camera.json}. Depth times depth_scale is in millimetres.",
        show_default=False,
    ),
]
"""Of commands that read images."""

TrueDataset = Annotated[
    Path,
    typer.Argument(
        help="Dataset in BOP layout, with ground truth.", show_default=False
    ),
]
"""Of commands that judge poses."""

NewDataset = Annotated[
    Path, typer.Argument(help="Folder of the new dataset.", show_default=False)
]
"""Of commands that make images."""

Split = Annotated[str, typer.Option(help="Folder of the images, below DATASET.")]
"""Of commands that read a dataset."""

DatasetModels = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        help="Folder of the object models.",
        show_default="DATASET/models",
    ),
]
"""Of commands that read a dataset and need its objects."""

LibraryFolder = Annotated[
    Path,
    typer.Option(
        metavar="DIR", help="Folder of the object models.", show_default="apc11"
    ),
]
"""Of commands that need no dataset; `APC11` by default."""

Targets = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="File that says which objects to look for in which image.",
        show_default="test_targets_bop19.json of DATASET, else its ground truth",
    ),
]
"""Of commands that estimate poses in a dataset."""

JsonFile = Annotated[
    Path | None,
    typer.Option(
        "--json",
        metavar="FILE",
        help="Also write all results to FILE, as JSON; - prints JSON and nothing else.",
    ),
]
"""Of commands that print a table: `output_json` keeps to it."""

# Detections.

Detections = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="File that says where the objects are, in BOP's JSON format: boxes as "
        "left, top, width, height in pixels, or masks.",
        show_default="detections.json of DATASET, else what the network of the "
        "package detects",
    ),
]
"""Of commands that estimate poses in a dataset."""

Masks = Annotated[
    bool,
    typer.Option(
        "--masks", help="Take the dataset's masks (mask_visib) instead of detections."
    ),
]
"""Of commands that estimate poses in a dataset."""

NetworkWeights = Annotated[
    Path,
    typer.Option(
        "--weights",
        metavar="FILE",
        help="Weights of the network; physim-drake train writes them.",
        show_default="those of apc11",
    ),
]
"""Of commands that cannot do without a network; `DETECTOR` by default."""

LeastScore = Annotated[
    float,
    typer.Option(min=0.0, max=1.0, help="Detections of a lower score are dropped."),
]
"""Of commands that detect."""

# Estimates.

Surface = Annotated[
    str,
    typer.Option(
        metavar="auto|Z_METRES|none",
        help="Height of the support surface in the world, in metres; auto finds the "
        "surface in each image. With none, or if auto finds none, nothing carries the "
        "objects: they are registered and refined without gravity.",
    ),
]
"""Of commands that estimate poses; `surface_height` reads it."""

Expansions = Annotated[
    int,
    typer.Option(
        min=1,
        help="Budget of the search: the number of states that it tries for each group "
        "of objects.",
    ),
]
"""Of commands that search."""

Hypotheses = Annotated[
    int,
    typer.Option(
        min=1, help="Number of poses of each object that the search chooses from."
    ),
]
"""Of commands that search."""

Plain = Annotated[
    bool,
    typer.Option(
        "--plain",
        help="Search as the paper does: make all expansions, however little they gain, "
        "and search only once.",
    ),
]
"""Of commands that search."""

Vsd = Annotated[
    bool,
    typer.Option(
        "--vsd/--no-vsd",
        help="Whether to compute VSD as well, which takes long: every pose is "
        "rendered.",
    ),
]
"""Of commands that judge poses."""

# Scenes.

SceneViews = Annotated[
    int,
    typer.Option(min=1, help="Number of images of each scene, from different sides."),
]
"""Of commands that generate scenes."""

ContainerOption = Annotated[
    ContainerName, typer.Option("--container", help="What the objects stand on or in.")
]
"""Of commands that generate scenes."""

# How a command works.

Seed = Annotated[int, typer.Option(min=0, help="Seed of all random choices.")]
"""Of commands that choose at random."""

Workers = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        min=1,
        help="Number of worker processes. The results do not depend on it.",
        show_default=f"one for each core, at most {MAX_DEFAULT_WORKERS}",
    ),
]
"""Of commands that use several processes; `default_workers()` by default."""

Threads = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="Number of CPU threads of the network.",
        show_default="one for each core",
    ),
]
"""Of commands that run a network."""

EngineOption = Annotated[
    Engine,
    typer.Option(
        "--engine",
        help="Where the work is done: local is this machine, ray is the Ray cluster "
        "that the variable RAY_ADDRESS names. The results are the same.",
    ),
]
"""Of commands whose work can be divided."""

Resume = Annotated[
    bool,
    typer.Option(
        "--resume", help="Go on with an earlier run: keep all that it finished."
    ),
]
"""Of commands whose runs can be cut off."""

Quiet = Annotated[
    bool,
    typer.Option("--quiet", "-q", help="Show no progress, only results and errors."),
]
"""Of commands that take long: `messages(quiet)` keeps to it."""

LogLevel = Annotated[
    LogLevelName,
    typer.Option(
        "--log-level",
        callback=set_log_level,
        help="Show messages from within, Drake's included, from this severity on.",
    ),
]
"""Of commands that take long; its callback does all, so that the value is unused."""


def surface_height(text: str) -> float | None:
    """The height that `--surface auto|Z_METRES|none` gives, m, or None for auto.

    It is -inf for none.

    Raises:
        InputError: if it is none of these.
    """
    if text == "auto":
        return None
    if text == "none":
        return -math.inf
    try:
        height = float(text)
    except ValueError:
        height = math.nan
    if not math.isfinite(height):
        raise InputError(
            "--surface", f"is {text!r}", "give auto, none, or the height in metres"
        )
    return height
