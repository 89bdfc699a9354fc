# SPDX-License-Identifier: MIT
"""How long each stage of an estimate takes."""

from __future__ import annotations

import time
from collections.abc import Mapping


class StageClock:
    """Seconds spent in each stage.

    Args:
        before: seconds by stage, of what was done before.
    """

    def __init__(self, before: Mapping[str, float] | None = None) -> None:
        self.stages: dict[str, float] = dict(before or {})
        self._last = time.monotonic()

    def lap(self, stage: str) -> None:
        """Books the time since the last lap under `stage`."""
        now = time.monotonic()
        self.stages[stage] = self.stages.get(stage, 0.0) + now - self._last
        self._last = now
