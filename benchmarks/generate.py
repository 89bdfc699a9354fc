# SPDX-License-Identifier: MIT
"""What a generated image costs: python benchmarks/generate.py [SCENES].

Three-object scenes of levels 1, 2 and 3 in turn, one image each, from drawing to the
files on the disk, in CPU seconds of one thread, and for each stage. A stage's
time includes tries that were rejected.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary
from physim_drake.rendering import scene as rendering
from physim_drake.scenes import generation, placement, plant, recording, views

STAGES: list[tuple[str, Any, str]] = [
    ("parse models", plant.ScenePlant, "__init__"),
    ("place", placement.Placer, "place"),
    ("settle", plant.ScenePlant, "settle"),
    ("make renderer", rendering.SceneRenderer, "__init__"),
    ("find view", recording, "find_view"),
    ("render", rendering.SceneRenderer, "render"),
    ("depth noise", views, "measure_depth"),
    ("colour noise", views, "expose"),
    ("write files", recording, "write_bop_scene"),
]


def main() -> None:
    """Prints the median by level and the mean of each stage."""
    scenes = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    library = ObjectLibrary.load(APC11)
    config = recording.DatasetConfig(seed=0, min_objects=3, max_objects=3)
    spent: dict[str, float] = defaultdict(float)
    for name, owner, attribute in STAGES:
        setattr(owner, attribute, timed(getattr(owner, attribute), spent, name))
    seconds = defaultdict(list)
    with tempfile.TemporaryDirectory() as folder:
        files = generation.write_models(library, Path(folder) / "models")
        split = Path(folder) / "test"
        recording.write_scene(split, library, config, scenes + 1, files)  # warms up
        spent.clear()
        for scene_id in range(1, scenes + 1):
            start = time.process_time()
            recording.write_scene(split, library, config, scene_id, files)
            level = config.scene(scene_id).level
            seconds[level].append(time.process_time() - start)
    print("level  median  mean   max (CPU s an image)")
    everything = [x for values in seconds.values() for x in values]
    for name, values in [*sorted(seconds.items()), ("all", everything)]:
        print(
            f"{name:<6} {np.median(values):.2f}    {np.mean(values):.2f}   "
            f"{np.max(values):.2f}"
        )
    for stage, total in sorted(spent.items(), key=lambda item: -item[1]):
        print(f"{stage:14s} {total / scenes:.3f}")


def timed(
    function: Callable[..., Any], spent: dict[str, float], name: str
) -> Callable[..., Any]:
    """`function`, whose CPU time is added to `spent[name]`."""

    def call(*args: Any, **kwargs: Any) -> Any:
        start = time.process_time()
        try:
            return function(*args, **kwargs)
        finally:
            spent[name] += time.process_time() - start

    return call


if __name__ == "__main__":
    main()
