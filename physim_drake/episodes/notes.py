# SPDX-License-Identifier: MIT
"""Notes of finished episodes, from which a run that was cut off can go on."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from physim_drake.episodes.result import EpisodeResult
from physim_drake.picking.scenario import PickScenario
from physim_drake.storage.dataclass_json import from_plain, to_plain
from physim_drake.storage.json_nodes import JsonNode
from physim_drake.storage.progress_file import ProgressFile

_WITHOUT_EFFECT = "look.workers"


class EpisodeNotes:
    """The results of a run's finished episodes.

    A result is kept as it is read from a file, whether or not it came from one, so that
    the report of a run does not depend on whether it was cut off.

    Args:
        progress: file that keeps them; None keeps them for this run only.
        earlier: notes that an earlier run left there.

    Attributes:
        results: results by the episode's number, from 0.

    Raises:
        InputError: if a note is not that of an episode.
    """

    def __init__(
        self, progress: ProgressFile | None = None, earlier: Iterable[JsonNode] = ()
    ) -> None:
        self._progress = progress
        self.results: dict[int, EpisodeResult] = {}
        for note in earlier:
            self._keep(note)

    def add(self, result: EpisodeResult) -> EpisodeResult:
        """Notes an episode and returns it as it is kept.

        Raises:
            InputError: if the file cannot be written, or is not there any more.
        """
        note = to_plain(result)
        source = Path("episodes")
        if self._progress is not None:
            self._progress.check_in_place()
            self._progress.add(note)
            source = self._progress.path
        return self._keep(JsonNode(json.loads(json.dumps(note)), source))

    def _keep(self, note: JsonNode) -> EpisodeResult:
        result = from_plain(note, EpisodeResult)
        self.results[result.episode] = result
        return result


def scenario_settings(scenario: PickScenario) -> dict[str, str]:
    """The settings that decide about a scenario's episodes, as text by name."""
    settings = _flat(scenario)
    del settings[_WITHOUT_EFFECT]
    return settings


def _flat(value: Any, start: str = "") -> dict[str, str]:
    """The values of a dataclass and of those within, as text."""
    settings: dict[str, str] = {}
    for field in fields(value):
        name, item = f"{start}{field.name}", getattr(value, field.name)
        if is_dataclass(item):
            settings |= _flat(item, f"{name}.")
        else:
            settings[name] = str(item)
    return settings
