# SPDX-License-Identifier: MIT
"""Episodes of a pick cell as an HTML page beside their replays."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from physim_drake.episodes.result import EpisodeResult, figures
from physim_drake.picking.task_state import EventKind
from physim_drake.reporting.html import render_page
from physim_drake.storage.files import write_atomically

_GOOD = (EventKind.PLACED,)
_PLAIN = (EventKind.LOOK, EventKind.ESTIMATE, EventKind.PICK, EventKind.END)


def write_episodes_report(
    results: Sequence[EpisodeResult],
    replays: Sequence[str],
    seed: str,
    folder: Path,
) -> Path:
    """Writes `index.html` into a folder. The page needs neither network nor server.

    Args:
        results: the episodes.
        replays: for each of them, a file in the folder, a page of Meshcat's; may be
            empty.
        seed: seed of the episodes, for the title.
        folder: folder that exists.

    Returns:
        the page.

    Raises:
        InputError: if it cannot be written.
    """
    page = render_page(
        "episodes.html.j2",
        title=f"Pick cell, seed {seed}",
        overall=figures(results),
        episodes=[
            {
                "result": result,
                "figures": figures([result]),
                "replay": replays[n] if n < len(replays) else "",
                "looks": _looks(result),
                "kinds": {
                    kind: "good"
                    if kind in _GOOD
                    else "plain"
                    if kind in _PLAIN
                    else "bad"
                    for kind in EventKind
                },
            }
            for n, result in enumerate(results)
        ],
    )
    path = folder / "index.html"
    with write_atomically(path) as file:
        file.write(page)
    return path


def _looks(result: EpisodeResult) -> list[dict[str, object]]:
    """Rows of the table of pose errors."""
    rows: list[dict[str, object]] = []
    for look in result.looks:
        entries = [
            f"{e.name}: not found"
            if e.rotation is None or e.translation is None
            else f"{e.name}: {np.degrees(e.rotation):.2f}°, "
            f"{1000 * e.translation:.1f} mm, confidence {e.confidence:.2f}"
            for e in look.errors
        ]
        rows.append(
            {
                "number": look.number,
                "time": look.time,
                "entries": entries or [look.error or "the table is empty"],
            }
        )
    return rows
