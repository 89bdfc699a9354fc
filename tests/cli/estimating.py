# SPDX-License-Identifier: MIT
"""Runs of `physim-drake estimate` on two small images."""

from __future__ import annotations

import json
import math
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from physim_drake.cli import main
from physim_drake.models import APC11

SCENE = Path(__file__).parents[2] / "examples" / "data" / "tabletop"
BOTTLE = 5

Run = Callable[..., int | str | None]


def estimate_command(monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs `physim-drake estimate` and gives its exit status."""

    def call(*arguments: str | Path) -> int | str | None:
        argv = ["physim-drake", "estimate", *map(str, arguments)]
        monkeypatch.setattr(sys, "argv", argv)
        # On a slow machine there would be lines about how far it is.
        monkeypatch.setattr("physim_drake.cli.progress.LINE_EVERY", math.inf)
        with pytest.raises(SystemExit) as caught:
            main()
        return caught.value.code

    return call


def two_images(root: Path) -> Path:
    """The example's image twice, 0 and 1, with the bottle as the only target."""
    shutil.copytree(SCENE, root)
    scene = root / "test" / "000001"
    for name in ("rgb", "depth"):
        shutil.copy(scene / name / "000000.png", scene / name / "000001.png")
    for path in sorted((scene / "mask_visib").glob("000000_*.png")):
        shutil.copy(path, path.with_name(path.name.replace("000000_", "000001_", 1)))
    for name in ("scene_camera.json", "scene_gt.json", "scene_gt_info.json"):
        edit(scene / name, lambda value: value | {"1": value["0"]})
    for name, key in (
        ("detections.json", "image_id"),
        ("test_targets_bop19.json", "im_id"),
    ):
        edit(root / name, lambda value, key=key: twice(value, key))
    return root


def twice(entries: list[dict[str, Any]], key: str) -> list[dict[str, Any]]:
    """The bottle's entries for image 0 and image 1."""
    kept = [e for e in entries if e.get("obj_id", e.get("category_id")) == BOTTLE]
    return kept + [entry | {key: 1} for entry in kept]


def edit(path: Path, change: Callable[[Any], Any]) -> None:
    """Rewrites a JSON file."""
    path.write_text(json.dumps(change(json.loads(path.read_text()))))


def quick(dataset: Path, out: Path) -> tuple[str | Path, ...]:
    """Arguments of the fastest run."""
    start = (dataset, "--out", out, "--models", APC11, "--workers", "1")
    return (*start, "--method", "super4pcs-icp", "--hypotheses", "5")


def without_time(path: Path) -> list[str]:
    return [line.rpartition(",")[0] for line in path.read_text().splitlines()]
