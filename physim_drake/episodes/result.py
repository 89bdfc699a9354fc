# SPDX-License-Identifier: MIT
"""Results of episodes: figures, errors and reasons, judged by the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from physim_drake.evaluation.matching import ObjectError
from physim_drake.picking.task_state import EventKind, TaskEvent

_FAILURES = (
    EventKind.GIVEN_UP,
    EventKind.DROPPED,
    EventKind.NO_SEAL,
    EventKind.NO_PLAN,
    EventKind.NO_ESTIMATE,
)


@dataclass(frozen=True)
class ObjectOutcome:
    """One object of an episode.

    Attributes:
        name: name of the object.
        level: interaction level at the beginning, 1 to 3.
        cleared: whether it truly ended in the tote.
        reason: why it did not; empty if it did.
    """

    name: str
    level: int
    cleared: bool
    reason: str = ""


@dataclass(frozen=True)
class LookOutcome:
    """One look of an episode.

    Attributes:
        number: number of the look, from 1.
        time: simulated time, s.
        errors: errors of the estimate, for each object that truly lay on the table.
        error: why there was no estimate; empty if there was one.
    """

    number: int
    time: float
    errors: tuple[ObjectError, ...]
    error: str = ""


@dataclass(frozen=True)
class EpisodeResult:
    """One episode.

    Attributes:
        episode: number of the episode, from 0.
        objects: objects that lay on the table, and where they ended.
        looks: looks with their errors.
        events: log of what the task did and why.
        simulated: simulated time, s.
        stages: wall time by stage, s.
    """

    episode: int
    objects: tuple[ObjectOutcome, ...]
    looks: tuple[LookOutcome, ...]
    events: tuple[TaskEvent, ...]
    simulated: float
    stages: Mapping[str, float]

    def count(self, kind: EventKind) -> int:
        """How many events of a kind there were."""
        return sum(event.kind is kind for event in self.events)

    @property
    def cleared(self) -> int:
        """Objects that ended in the tote."""
        return sum(o.cleared for o in self.objects)

    @property
    def picks(self) -> int:
        """Picks that were tried."""
        return self.count(EventKind.PICK)

    @property
    def succeeded(self) -> int:
        """Picks whose object was let go over the tote, and is in it."""
        return len(self._placed(True))

    @property
    def dropped(self) -> int:
        """Picks whose object was lost on the way, or fell beside the tote."""
        return self.count(EventKind.DROPPED) + len(self._placed(False))

    @property
    def wall(self) -> float:
        """Wall time, s."""
        return sum(self.stages.values())

    @property
    def end(self) -> str:
        """Why the episode ended."""
        return self.events[-1].text if self.events else ""

    @property
    def failures(self) -> tuple[TaskEvent, ...]:
        """The events that tell of something that went wrong."""
        return tuple(e for e in self.events if e.kind in _FAILURES)

    def _placed(self, cleared: bool) -> list[TaskEvent]:
        names = {o.name for o in self.objects if o.cleared}
        placed = [e for e in self.events if e.kind is EventKind.PLACED]
        return [e for e in placed if (e.name in names) is cleared]

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers, text and lists, for JSON."""
        return {
            "episode": self.episode,
            **figures([self]),
            "end": self.end,
            "left": [
                {"name": o.name, "level": o.level, "reason": o.reason}
                for o in self.objects
                if not o.cleared
            ],
            "look_errors": [_look_dict(look) for look in self.looks],
            "events": [
                {"time": round(e.time, 6), "kind": str(e.kind), "text": e.text}
                for e in self.events
            ],
        }


def reason_left(name: str, events: Sequence[TaskEvent]) -> str:
    """Why an object was left on the table, from the task's log."""
    for event in reversed(events):
        if event.name == name and event.kind in _FAILURES:
            return f"at {event.time:.1f} s: {event.text}"
    for event in reversed(events):
        if event.name == name and event.kind is EventKind.PLACED:
            return f"at {event.time:.1f} s it was let go, and fell beside the tote"
    end = events[-1].text if events else "nothing was done"
    return f"it was never picked; at the end: {end}"


def summary(results: Sequence[EpisodeResult]) -> dict[str, Any]:
    """All episodes for JSON: the figures over all, then each episode's."""
    return {**figures(results), "episodes": [r.as_dict() for r in results]}


def figures(results: Sequence[EpisodeResult]) -> dict[str, Any]:
    """The figures over some episodes, which docs/pick-cell.md explains."""
    simulated = sum(r.simulated for r in results)
    wall = sum(r.wall for r in results)
    succeeded = sum(r.succeeded for r in results)
    errors = [e for r in results for look in r.looks for e in look.errors]
    rotations = [e.rotation for e in errors if e.rotation is not None]
    distances = [e.translation for e in errors if e.translation is not None]
    stages: dict[str, float] = {}
    for r in results:
        for stage, seconds in r.stages.items():
            stages[stage] = stages.get(stage, 0.0) + seconds
    return {
        "objects": sum(len(r.objects) for r in results),
        "cleared": sum(r.cleared for r in results),
        "picks": sum(r.picks for r in results),
        "succeeded": succeeded,
        "dropped": sum(r.dropped for r in results),
        "not_sealed": sum(r.count(EventKind.NO_SEAL) for r in results),
        "looks": sum(len(r.looks) for r in results),
        "median_rotation_deg": _median(np.degrees(rotations)),
        "median_translation_mm": _median(1000 * np.array(distances)),
        "not_found": len(errors) - len(distances),
        "simulated_time": round(simulated, 6),
        "picks_per_hour": round(3600 * succeeded / simulated, 3) if simulated else 0.0,
        "wall_time": round(wall, 3),
        "real_time_factor": round(simulated / wall, 4) if wall else 0.0,
        "stages": {stage: round(seconds, 3) for stage, seconds in stages.items()},
    }


def _median(values: Any) -> float | None:
    return round(float(np.median(values)), 4) if len(values) else None


def _look_dict(look: LookOutcome) -> dict[str, Any]:
    return {
        "number": look.number,
        "time": round(look.time, 6),
        "error": look.error,
        "objects": [
            {
                "name": e.name,
                "rotation_deg": _degrees(e.rotation),
                "translation_mm": _millimetres(e.translation),
                "confidence": round(e.confidence, 4),
            }
            for e in look.errors
        ],
    }


def _degrees(angle: float | None) -> float | None:
    return None if angle is None else round(float(np.degrees(angle)), 4)


def _millimetres(distance: float | None) -> float | None:
    return None if distance is None else round(1000 * distance, 4)
