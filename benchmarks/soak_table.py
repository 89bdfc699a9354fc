# SPDX-License-Identifier: MIT
"""The table of a soak test's results."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from textwrap import shorten
from typing import Any

from benchmarks.fuzz import Finding
from benchmarks.kills import Tally

Figures = Mapping[str, Any]


@dataclass(frozen=True)
class Row:
    """A row of the table.

    Attributes:
        what: name of what was run.
        good: whether it passed.
        figures: results in words.
    """

    what: str
    good: bool
    figures: str


@dataclass(frozen=True)
class Outcome:
    """The result of one part.

    Attributes:
        part: "kills", "fuzz" or "load".
        settings: settings that tell its runs apart.
        figures: counts and measurements, empty if it broke down.
        seconds: time that it took.
        date: day on which it ended, as in 2026-01-31.
        commit: commit of the code.
        error: cause of a breakdown, or "".
    """

    part: str
    settings: Figures
    figures: Figures
    seconds: float
    date: str
    commit: str
    error: str = ""

    @property
    def good(self) -> bool:
        """Whether all of it went well."""
        return all(row.good for row in rows(self))


def rows(outcome: Outcome) -> list[Row]:
    """The rows of a part, or one row that says why it broke down."""
    if outcome.error:
        return [Row(outcome.part, False, f"broke down: {outcome.error}")]
    return _ROWS[outcome.part](outcome.settings, outcome.figures)


def wrong(outcome: Outcome) -> list[str]:
    """The other faults of a part, one a line."""
    if outcome.part == "kills":
        tallies = outcome.figures.values()
        return [shorten(text, 300) for tally in tallies for text in tally["wrong"]]
    if outcome.part == "fuzz":
        found = [Finding(**target) for target in outcome.figures.get("targets", [])]
        return [f"{f.target}: {', '.join(f.faults)}" for f in found if f.faults]
    return []


def markdown(outcomes: Sequence[Outcome], command: str, machine: str) -> str:
    """The page: the table, when and with what each part ran, and what went wrong.

    Args:
        outcomes: results of the parts that ran.
        command: command line that ran them.
        machine: machine in words.
    """
    failed = [outcome.part for outcome in outcomes if not outcome.good]
    verdict = f"failed: {', '.join(failed)}" if failed else "all parts passed"
    lines = [
        "# Endurance",
        "",
        f"`{command}` on {machine}: {verdict}.",
        "",
        "| part | what was run | outcome | figures |",
        "|---|---|---|---|",
    ]
    for outcome in outcomes:
        for row in rows(outcome):
            cells = (outcome.part, row.what, _verdict(row.good), row.figures)
            lines.append(f"| {' | '.join(c.replace('|', '¦') for c in cells)} |")
    lines.append("")
    for outcome in outcomes:
        took = f"{outcome.seconds / 60:.1f} min, {outcome.date}"
        lines.append(f"* `{outcome.part}`: {took}, commit {outcome.commit}")
        lines += [f"  * {text}" for text in wrong(outcome)]
    return "\n".join(lines) + "\n"


def _verdict(good: bool) -> str:
    return "passed" if good else "failed"


def _kill_rows(settings: Figures, figures: Figures) -> list[Row]:
    """One row a command, and one for all."""
    tallies = {name: Tally(**figure) for name, figure in figures.items()}
    result = [
        Row(f"`{name}`, cut off and resumed", tally.good, _kills(tally))
        for name, tally in tallies.items()
    ]
    everything = _sum(tallies.values())
    good = everything.good and everything.kills >= settings["kills"]
    return [*result, Row(f"{settings['kills']} kills", good, _kills(everything))]


def _sum(tallies: Iterable[Tally]) -> Tally:
    result = Tally()
    for tally in tallies:
        for name in vars(tally):
            if name != "slowest_stop":
                setattr(result, name, getattr(result, name) + getattr(tally, name))
        result.slowest_stop = max(result.slowest_stop, tally.slowest_stop)
    return result


def _kills(t: Tally) -> str:
    return (
        f"{t.survived} of {t.kills} kills survived (main process {t.main}, workers "
        f"{t.worker}, asked to stop {t.stopped}); {t.same} of {t.runs} results equal; "
        f"orphans {t.orphans}; litter {t.litter}; slowest stop {t.slowest_stop:.1f} s"
    )


def _fuzz_rows(settings: Figures, figures: Figures) -> list[Row]:
    """One row a reader, and one for all."""
    found = [Finding(**target) for target in figures["targets"]]
    result = [
        Row(
            f"readers of {f.target}, {f.seconds} s",
            f.good,
            f"{f.inputs:,} inputs, {len(f.faults)} failures, {f.memory_mb} MB",
        )
        for f in found
    ]
    inputs, faults = (sum(f.inputs for f in found), sum(len(f.faults) for f in found))
    total = f"{inputs:,} inputs, {faults} failures, made by {settings['engine']}"
    good = bool(found) and all(f.good for f in found)
    return [*result, Row(f"all readers, {settings['minutes']:g} min", good, total)]


def _load_rows(settings: Figures, figures: Figures) -> list[Row]:
    """One row."""
    growth = figures["growth"]
    memory = "too few images to tell growth"
    if growth is not None:
        memory = f"growth {100 * growth:.1f} %"
    for key, name in (("main", "main process"), ("workers", "workers together")):
        before, after = figures[f"early_{key}_mb"], figures[f"late_{key}_mb"]
        if None not in (before, after):
            memory += f"; {name} {before} MB after 20 images, {after} MB at the end"
    asked, done, status = settings["images"], figures["images"], figures["exit_status"]
    good = status == 0 and done == asked and figures["flat"] is not False
    pace = f"{figures['seconds'] / done:.1f} s an image; " if done else ""
    ended = "" if status == 0 else f"exit status {status}; "
    return [
        Row(
            f"one `estimate` of {asked:,} images, {figures['workers']} workers",
            good,
            f"{done:,} images; {ended}{pace}{memory}",
        )
    ]


_ROWS: Mapping[str, Callable[[Figures, Figures], list[Row]]] = {
    "kills": _kill_rows,
    "fuzz": _fuzz_rows,
    "load": _load_rows,
}
