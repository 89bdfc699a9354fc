# SPDX-License-Identifier: MIT
"""Runs every method over the same cases and sums up what came out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.peers.cases import Case, clocked
from benchmarks.peers.refinement import ours as our_refiner
from benchmarks.peers.refinement import peers as other_refiners
from benchmarks.peers.registration import Registration
from benchmarks.peers.settling import Engine
from benchmarks.peers.tables import Row, ratio
from physim_drake.poses import Array

Record = dict[str, Any]
Progress = Callable[[str], None]


def register(
    methods: Sequence[Registration],
    cases: Sequence[Case],
    limits: tuple[float, float],
    repeats: int,
    progress: Progress,
) -> list[Record]:
    """Finds every case's pose with every method, `repeats` times.

    Args:
        methods: methods to compare.
        cases: objects to find.
        limits: largest errors that count as success, degrees and cm.
        repeats: number of repeats, each with other random choices.
        progress: callback for the method at work.
    """
    records = []
    for method in methods:
        progress(method.name)
        warmed: set[int] = set()
        for case in cases:
            prepared = method.prepare(case.model)
            refining = method.refiner.prepare(case.model)
            if case.model.object_id not in warmed:  # compiles and tabulates
                _registered(method, prepared, refining, case, limits, 0)
                warmed.add(case.model.object_id)
            records += [
                _registered(method, prepared, refining, case, limits, seed)
                for seed in range(repeats)
            ]
    return records


def _registered(
    method: Registration,
    prepared: Any,
    refining: Any,
    case: Case,
    limits: tuple[float, float],
    seed: int,
) -> Record:
    poses, seconds = clocked(method.propose, prepared, case, seed)
    record: Record = {
        "method": method.name,
        "image": case.name,
        "index": case.index,
        "object": case.model.name,
        "repeat": seed,
        "poses": len(poses),
        "seconds": seconds,
        "refining_seconds": None,
        "best": False,
        "refined": False,
        "any": False,
        "rotation_deg": None,
        "translation_cm": None,
    }
    if len(poses) == 0:
        return record
    refined, refining_seconds = clocked(method.refiner.refine, refining, case, poses[0])
    rotation, translation = case.errors(np.concatenate([poses, refined[None]]))
    good = (rotation <= limits[0]) & (translation <= limits[1])
    kept = good[:-1][method.candidates]
    return record | {
        "refining_seconds": refining_seconds,
        "best": bool(good[0]),
        "refined": bool(good[-1]),
        "any": bool(kept.any()),
        "rotation_deg": float(rotation[-1]),
        "translation_cm": float(translation[-1]),
        "X_SO": refined.tolist(),
    }


def registration_rows(records: Sequence[Record]) -> list[Row]:
    """A row per method, ours first. Ratios are to ours."""
    rows: list[Row] = []
    for name, own in _by(records, "method").items():
        seconds = float(np.median([r["seconds"] for r in own]))
        refining = [r["refining_seconds"] or 0.0 for r in own]
        rows.append(
            {
                "method": name,
                "n": len(own),
                "best %": _percent(own, "best"),
                "+ICP %": _percent(own, "refined"),
                "any %": _percent(own, "any"),
                "poses": int(np.median([r["poses"] for r in own])),
                "deg": _median(own, "rotation_deg"),
                "cm": _median(own, "translation_cm"),
                "s": seconds,
                "ICP ms": 1000 * float(np.median(refining)),
            }
        )
    for row in rows:
        row["+ICP, ratio"] = ratio(row["+ICP %"], rows[0]["+ICP %"])
        row["s, ratio"] = ratio(row["s"], rows[0]["s"])
    return rows


def object_rows(records: Sequence[Record]) -> list[Row]:
    """By object, the share each method finds, and wins : losses of ours against it."""
    methods = _by(records, "method")
    ours = next(iter(methods))
    rows: list[Row] = []
    for name, own in {**_by(records, "object"), "all": list(records)}.items():
        of_method = _by(own, "method")
        row: Row = {"object": name, "n": len(of_method[ours]), ours: ""}
        row[ours] = f"{_percent(of_method[ours], 'refined'):.0f} %"
        for peer in list(methods)[1:]:
            wins, losses = _duel(of_method[ours], of_method[peer])
            share = _percent(of_method[peer], "refined")
            row[peer] = f"{share:.0f} %  {wins}:{losses}"
        rows.append(row)
    return rows


def _duel(ours: Sequence[Record], theirs: Sequence[Record]) -> tuple[int, int]:
    """How often only ours succeeds, and how often only theirs does."""
    pairs = list(zip(ours, theirs, strict=True))
    wins = sum(a["refined"] and not b["refined"] for a, b in pairs)
    return wins, sum(b["refined"] and not a["refined"] for a, b in pairs)


def refine(
    cases: Sequence[Case],
    start: tuple[float, float],
    limits: tuple[float, float],
    repeats: int,
) -> list[Row]:
    """Every refiner from the same starts, so many degrees and metres off."""
    rows: list[Row] = []
    for refiner in [our_refiner(), *other_refiners()]:
        ends, seconds = [], []
        for case in cases:
            prepared = refiner.prepare(case.model)
            refiner.refine(prepared, case, case.X_SO)  # compiles
            for seed in range(repeats):
                X_SO = case.perturbed(*start, seed)
                X_SO, spent = clocked(refiner.refine, prepared, case, X_SO)
                ends.append((case, X_SO))
                seconds.append(spent)
        rows.append({"method": refiner.name, **_end_row(ends, limits, seconds)})
    return _with_ratios(rows)


def settle(
    engines: Sequence[Engine],
    cases: Sequence[Case],
    start: tuple[float, float],
    limits: tuple[float, float],
    repeats: int,
    progress: Progress,
) -> list[Row]:
    """Every engine from the same starts, each object among the true others."""
    begun = [(c, c.perturbed(*start, seed)) for c in cases for seed in range(repeats)]
    rows = [{"method": "(as it begins)", **_end_row(begun, limits, None)}]
    for engine in engines:
        progress(engine.name)
        ends, seconds = [], []
        for case in cases:
            others = [(c.model, c.X_SO) for c in cases if _beside(case, c)]
            scene = engine.build(case, others)
            engine.settle(scene, case.X_SO)
            for seed in range(repeats):
                X_SO = case.perturbed(*start, seed)
                X_SO, spent = clocked(engine.settle, scene, X_SO)
                ends.append((case, X_SO))
                seconds.append(spent)
        rows.append({"method": engine.name, **_end_row(ends, limits, seconds)})
    return _with_ratios(rows, reference=1)


def _beside(case: Case, other: Case) -> bool:
    return other.name == case.name and other.index != case.index


def _end_row(
    ends: Sequence[tuple[Case, Array]],
    limits: tuple[float, float],
    seconds: Sequence[float] | None,
) -> Row:
    errors = np.array(
        [np.concatenate(case.errors(X_SO[None])) for case, X_SO in ends]
    ).reshape(-1, 2)
    return {
        "n": len(errors),
        "ok %": 100 * float((errors <= limits).all(axis=1).mean()),
        "deg": float(np.median(errors[:, 0])),
        "mm": 10 * float(np.median(errors[:, 1])),
        "deg, mean": float(errors[:, 0].mean()),
        "mm, mean": 10 * float(errors[:, 1].mean()),
        "ms": 1000 * float(np.median(seconds)) if seconds else None,
    }


def _with_ratios(rows: list[Row], reference: int = 0) -> list[Row]:
    for key in ("mm", "ms"):
        for row in rows:
            row[f"{key}, ratio"] = ratio(row[key], rows[reference][key])
    return rows


def _by(records: Sequence[Record], key: str) -> dict[str, list[Record]]:
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(str(record[key]), []).append(record)
    return groups


def _percent(records: Sequence[Record], key: str) -> float:
    return 100 * float(np.mean([bool(r[key]) for r in records]))


def _median(records: Sequence[Record], key: str) -> float | None:
    known = [r[key] for r in records if r[key] is not None]
    return float(np.median(known)) if known else None
