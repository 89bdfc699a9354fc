# SPDX-License-Identifier: MIT
"""The method and its effort: what files of settings say of an estimate."""

from __future__ import annotations

from dataclasses import dataclass, replace

from physim_drake.errors import InputError
from physim_drake.estimation.config import EstimationConfig, Method


@dataclass(frozen=True)
class MethodConfig:
    """Which method estimates poses, and with what effort; see `EstimationConfig`.

    Attributes:
        method: way to estimate.
        expansions: budget of the search, for each group of objects.
        representatives: number of hypotheses of an object that the search chooses
            from.
        workers: number of processes; the result does not depend on it.
    """

    method: Method = Method.PHYSIM_MCTS
    expansions: int = 250
    representatives: int = 25
    workers: int = 1

    _section = "estimator"  # what messages call it

    def __post_init__(self) -> None:
        self._check_positive("expansions", "representatives", "workers")

    def applied_to(self, config: EstimationConfig) -> EstimationConfig:
        """Another configuration with this method and effort."""
        config = replace(config, method=self.method, workers=self.workers)
        return config.with_budget(self.expansions, self.representatives)

    def _check_positive(self, *names: str) -> None:
        for name in names:
            value = getattr(self, name)
            if value < 1:
                raise InputError(
                    self._section, f"is {value}", "give a positive number", name
                )
