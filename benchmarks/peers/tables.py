# SPDX-License-Identifier: MIT
"""Tables of figures, on the console and for JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

Row = dict[str, Any]


def show(console: Console, title: str, rows: Sequence[Row], note: str = "") -> None:
    """Prints rows of the same keys, which name their units."""
    table = Table(
        box=box.SIMPLE_HEAD, title=title, title_justify="left", padding=(0, 1)
    )
    for n, name in enumerate(rows[0]):
        table.add_column(name, justify="right" if n else "left", no_wrap=n > 0)
    for row in rows:
        table.add_row(*(_text(value) for value in row.values()))
    console.print(table)
    if note:
        console.print(note)


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def ratio(value: float | None, reference: float | None) -> float | None:
    """`value` as a multiple of `reference`; None if that says nothing."""
    return value / reference if value is not None and reference else None
