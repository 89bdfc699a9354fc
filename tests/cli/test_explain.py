# SPDX-License-Identifier: MIT
from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from physim_drake.cli import main
from physim_drake.cli.options import surface_height
from physim_drake.errors import InputError
from physim_drake.models import APC11

SCENE = Path(__file__).parents[2] / "examples" / "data" / "tabletop"

Run = Callable[..., int | str | None]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs `physim-drake explain` and gives its exit status."""

    def call(*arguments: str | Path) -> int | str | None:
        argv = ["physim-drake", "explain", *map(str, arguments)]
        monkeypatch.setattr(sys, "argv", argv)
        with pytest.raises(SystemExit) as caught:
            main()
        return caught.value.code

    return call


def test_writes_a_page_and_tells_where(
    run: Run,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("physim_drake.cli.progress.LINE_EVERY", 0.0)
    out = tmp_path / "new" / "folder"
    budget = ("--expansions", "6", "--hypotheses", "6", "--workers", "1")
    given = ("--image", "1/0", "--models", APC11, "--masks", "--surface", "0")
    assert run(SCENE, "--out", out, *given, *budget) == 0
    path = out / "000001_000000.html"
    told = capsys.readouterr()
    assert told.out == f"{path}\n"
    steps = ("1 of 3 steps, estimating", "2 of 3 steps, drawing")
    assert all(step in told.err for step in steps)
    page = path.read_text()
    assert "6 expansions a group" in page
    assert "It is given by its height" in page
    assert page.count("poses, 6 kept") == 3


@pytest.mark.parametrize(
    ("image", "problem"),
    [("1/7", "1/7 has no target"), ("one", "'one' is not an image")],
)
def test_an_image_that_is_not_there_is_one_line(
    run: Run,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    image: str,
    problem: str,
) -> None:
    assert run(SCENE, "--image", image, "--out", tmp_path, "--models", APC11) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: --image: {problem}")
    assert error.count("\n") == 1


def test_surface_is_auto_or_a_height() -> None:
    assert surface_height("auto") is None
    assert surface_height("-0.25") == -0.25
    for text in ("table", "nan", "inf", ""):
        with pytest.raises(InputError, match="give auto, none, or the height"):
            surface_height(text)
