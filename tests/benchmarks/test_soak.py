# SPDX-License-Identifier: MIT
"""The table, the exit status and --resume, with stand-ins that end at once."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner, Result

from benchmarks import soak
from benchmarks.fuzz import Finding
from benchmarks.kills import Tally
from benchmarks.soak_table import Outcome, markdown, rows

KILLED = Tally(
    main=2, worker=1, stopped=1, survived=4, runs=3, same=3, slowest_stop=1.25
)
READ = Finding("rle", inputs=1200, seconds=30, memory_mb=300, faults=[])
LOADED = {
    **{"images": 1000, "main_peak_mb": 450, "workers_peak_mb": 900},
    **{"early_main_mb": 400, "late_main_mb": 410},
    **{"early_workers_mb": 800, "late_workers_mb": 805},
    **{"growth": 0.0125, "flat": True},
    **{"workers": 2, "library": 11, "seconds": 2100.0, "exit_status": 0},
}
SETTINGS = {
    "kills": {"kills": 8, "seed": 0},
    "fuzz": {"minutes": 10.0, "engine": "atheris"},
    "load": {"images": 1000},
}


def kills(**changed: Any) -> dict[str, Any]:
    """Figures of two commands, the second of which went as told."""
    return {"estimate": asdict(KILLED), "train": asdict(replace(KILLED, **changed))}


def read(**changed: Any) -> dict[str, Any]:
    """Figures of two readers, the second of which went as told."""
    second = replace(READ, **{"target": "png", "inputs": 34} | changed)
    return {"targets": [asdict(READ), asdict(second)]}


FIGURES = {"kills": kills(), "fuzz": read(), "load": LOADED}


def outcome(part: str, figures: dict[str, Any], error: str = "") -> Outcome:
    return Outcome(part, SETTINGS[part], figures, 90.0, "2026-01-31", "abc1234", error)


def test_rows_say_what_was_counted() -> None:
    estimate, train, total = rows(outcome("kills", kills(orphans=2)))
    assert (estimate.good, train.good, total.good) == (True, False, False)
    assert "8 of 8 kills survived (main process 4, workers 2" in total.figures
    assert "6 of 6 results equal; orphans 2; litter 0" in total.figures
    assert "slowest stop 1.2 s" in total.figures
    _, png, total = rows(outcome("fuzz", read()))
    assert png.figures == "34 inputs, 0 failures, 300 MB"
    assert total.figures == "1,234 inputs, 0 failures, made by atheris"
    (row,) = rows(outcome("load", LOADED))
    assert row.figures == (
        "1,000 images; 2.1 s an image; growth 1.2 %; main process 400 MB after 20 "
        "images, 410 MB at the end; workers together 800 MB after 20 images, 805 MB "
        "at the end"
    )


@pytest.mark.parametrize("part", soak.PARTS)
def test_a_part_without_faults_passes(part: str) -> None:
    assert outcome(part, FIGURES[part]).good
    assert not outcome(part, FIGURES[part], "OSError: no space").good


@pytest.mark.parametrize(
    ("part", "figures"),
    [
        ("kills", {"estimate": asdict(KILLED)}),  # fewer kills than asked for
        ("kills", {}),
        ("kills", kills(same=2)),
        ("kills", kills(litter=1)),
        ("kills", kills(wrong=["estimate: missing ['results.csv']"])),
        ("fuzz", read(faults=["png-crash-1"])),
        ("fuzz", read(inputs=0)),
        ("fuzz", {"targets": []}),
        ("load", LOADED | {"images": 999}),
        ("load", LOADED | {"exit_status": 1}),
        ("load", LOADED | {"flat": False}),
    ],
)
def test_whatever_goes_wrong_fails_its_part(part: str, figures: dict[str, Any]) -> None:
    assert not outcome(part, figures).good


def test_memory_of_few_images_is_left_open() -> None:
    unknown = dict.fromkeys(k for k in LOADED if k.startswith(("early", "late")))
    figures = LOADED | unknown | {"growth": None, "flat": None}
    (row,) = rows(outcome("load", figures))
    assert row.good
    assert row.figures.endswith("too few images to tell growth")


def test_the_page_has_the_table_and_names_what_failed() -> None:
    parts = [
        outcome("kills", kills(wrong=["estimate: other\n  ['results.csv']"])),
        outcome("fuzz", read(faults=["png-crash-1"])),
        outcome("load", {}, "OSError: no | space"),
    ]
    page = markdown(parts, "make soak", "2 cores")
    assert "`make soak` on 2 cores: failed: kills, fuzz, load." in page
    assert "| fuzz | readers of rle, 30 s | passed | 1,200 inputs, 0 fail" in page
    assert "| load | load | failed | broke down: OSError: no ¦ space |" in page
    assert "* `kills`: 1.5 min, 2026-01-31, commit abc1234\n" in page
    assert "  * estimate: other ['results.csv']\n" in page
    assert "  * png: png-crash-1\n" in page
    assert "all parts passed" in markdown([outcome("load", LOADED)], "make soak", "")


class Parts:
    """Jobs that give known figures and count how often they ran."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.ran: list[str] = []
        self.figures: dict[str, Any] = dict(FIGURES)
        for part, name in zip(
            soak.PARTS, ("kill_job", "fuzz_job", "load_job"), strict=True
        ):
            monkeypatch.setattr(soak, name, self._maker(part))

    def _maker(self, part: str) -> Callable[..., soak.Job]:
        def make(amount: float, *_: object) -> soak.Job:
            def run() -> dict[str, Any]:
                self.ran.append(part)
                if isinstance(self.figures[part], BaseException):
                    raise self.figures[part]
                return self.figures[part]

            settings = {next(iter(SETTINGS[part])): amount}
            return soak.Job(part, SETTINGS[part] | settings, run)

        return make


@pytest.fixture
def parts(monkeypatch: pytest.MonkeyPatch) -> Parts:
    monkeypatch.setattr(soak.signal, "signal", lambda *_: None)  # pytest's stay
    return Parts(monkeypatch)


def command(folder: Path, *options: str) -> Result:
    app = typer.Typer()
    app.command()(soak.main)
    out = folder / "deep" / "soak.md"
    return CliRunner().invoke(app, ["--kills", "8", "--out", str(out), *options])


def test_it_passes_where_all_parts_do(parts: Parts, tmp_path: Path) -> None:
    done = command(tmp_path)
    assert done.exit_code == 0, done.output
    assert parts.ran == ["kills", "fuzz", "load"]
    page = (tmp_path / "deep" / "soak.md").read_text()
    assert "--kills 8 --fuzz-minutes 10 --images 1000" in page
    assert "all parts passed" in page
    assert "failed" not in page
    kept = json.loads((tmp_path / "deep" / "soak.json").read_text())
    assert {part: fields["figures"] for part, fields in kept.items()} == FIGURES


def test_a_failure_is_told_and_the_other_parts_still_run(
    parts: Parts, tmp_path: Path
) -> None:
    parts.figures["kills"] = kills(orphans=1)
    parts.figures["fuzz"] = RuntimeError("no shared memory")
    done = command(tmp_path)
    assert done.exit_code == 1
    assert parts.ran == ["kills", "fuzz", "load"]
    page = (tmp_path / "deep" / "soak.md").read_text()
    assert "failed: kills, fuzz." in page
    assert "broke down: RuntimeError: no shared memory" in page


@pytest.mark.parametrize(
    ("signal", "status"), [(KeyboardInterrupt(), 130), (SystemExit(143), 143)]
)
def test_what_was_done_before_an_interrupt_is_not_run_again(
    parts: Parts, tmp_path: Path, signal: BaseException, status: int
) -> None:
    parts.figures["fuzz"] = signal
    done = command(tmp_path)
    assert done.exit_code == status
    assert not (tmp_path / "deep" / "soak.md").exists()
    parts.figures["fuzz"], parts.ran = read(), []
    assert command(tmp_path, "--resume").exit_code == 0
    assert parts.ran == ["fuzz", "load"]


def test_only_finished_parts_with_the_same_settings_are_kept(
    parts: Parts, tmp_path: Path
) -> None:
    parts.figures["kills"] = kills(litter=1)
    parts.figures["fuzz"] = OSError("no space")
    assert command(tmp_path).exit_code == 1
    parts.figures, parts.ran = dict(FIGURES), []
    assert command(tmp_path, "--resume").exit_code == 1  # the litter stays
    assert parts.ran == ["fuzz"]
    assert command(tmp_path, "--resume", "--images", "999").exit_code == 1
    assert parts.ran == ["fuzz", "load"]
    assert command(tmp_path).exit_code == 0
    assert parts.ran == ["fuzz", "load", "kills", "fuzz", "load"]


def test_parts_can_be_chosen(parts: Parts, tmp_path: Path) -> None:
    assert command(tmp_path, "--only", "load").exit_code == 0
    assert parts.ran == ["load"]
    assert command(tmp_path, "--only", "load,lode").exit_code == 2
