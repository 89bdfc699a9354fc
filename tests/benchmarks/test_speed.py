# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from pathlib import Path

import typer
from typer.testing import CliRunner

from benchmarks import speed


def test_the_search_of_the_paper_never_ends_early() -> None:
    plain, default = (
        speed.configuration(speed.Search(s)) for s in ("plain", "default")
    )
    assert plain.search.expansions == default.search.expansions == 250
    assert plain.search.patience_per_object > 1e9 > default.search.patience_per_object
    assert plain.rounds == 1


def test_figures_of_a_small_scene(tmp_path: Path) -> None:
    app = typer.Typer()
    app.command()(speed.main)
    file = tmp_path / "speed.json"
    options = ["--repeats", "1", "--objects", "1", "--piles", "", "--workers", "1"]
    done = CliRunner().invoke(app, [*options, "--json", str(file)])
    assert done.exit_code == 0, done.output
    report = json.loads(file.read_text())
    assert report["scored_poses_an_object"] > 1000
    assert report["main_memory_mb"] > 100
    (row,) = report["scenes"]
    assert (row["kind"], row["objects"], row["workers"]) == ("apart", 1, 1)
    assert row["image_s"] > 0
    assert row["within_5deg_1cm"] == 1.0
