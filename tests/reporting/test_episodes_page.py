# SPDX-License-Identifier: MIT
from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from physim_drake.picking.task_state import EventKind, TaskEvent
from physim_drake.reporting.episodes_page import write_episodes_report
from tests.browser import needs_chromium, opened
from tests.episodes.test_result import EVENTS, result


def page(folder: Path, replays: tuple[str, ...] = ()) -> str:
    results = [result(), result(episode=1)]
    path = write_episodes_report(results, replays, "7", folder)
    assert path == folder / "index.html"
    return path.read_text(encoding="utf-8")


def test_every_failure_is_there_with_when_what_and_why(tmp_path: Path) -> None:
    text = page(tmp_path)
    for event in result().failures:
        assert f"{event.time:.2f} s" in text
        assert str(event.kind) in text
        assert event.text in text
    assert "left: fell beside the tote" in text


def test_figures_errors_and_log_are_there(tmp_path: Path) -> None:
    text = page(tmp_path)
    assert "2 of 6 objects were cleared" in text
    assert "real-time factor\n0.50" in text
    assert "soap: 1.00°, 2.0 mm, confidence 0.90" in text
    assert "ball: not found" in text
    for event in EVENTS:
        assert event.text in text


def test_the_page_asks_for_nothing_but_its_replays(tmp_path: Path) -> None:
    text = page(tmp_path, ("replay-001.html", "replay-002.html"))
    assert not re.search(r"https?://", text)
    links = re.findall(r'(?:src|href)="([^#"][^"]*)"', text)
    assert set(links) == {"replay-001.html", "replay-002.html"}
    assert text.count("<iframe") == 2
    assert "<iframe" not in page(tmp_path)


def test_names_cannot_break_the_page(tmp_path: Path) -> None:
    event = TaskEvent(1.0, EventKind.DROPPED, "<script>alert(1)</script>", "x")
    path = write_episodes_report(
        [replace(result(), events=(event,))], (), "0", tmp_path
    )
    assert "<script>" not in path.read_text(encoding="utf-8")


@needs_chromium
def test_the_page_fits_on_a_phone(tmp_path: Path) -> None:
    event = TaskEvent(1.0, EventKind.DROPPED, "elmers_washable_no_run_school_glue", "")
    write_episodes_report([replace(result(), events=(event,))], (), "0", tmp_path)
    with opened((tmp_path / "index.html").as_uri()) as shown:
        shown.set_viewport_size({"width": 390, "height": 800})
        shown.evaluate("document.querySelectorAll('details').forEach(d => d.open = 1)")
        assert shown.evaluate("document.documentElement.scrollWidth") == 390
