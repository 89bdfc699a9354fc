# SPDX-License-Identifier: MIT
"""The ways to estimate a scene, and everything that can be set about them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from physim_drake.errors import InputError
from physim_drake.estimation.method import Method as Method
from physim_drake.estimation.workers import WorkerConfig
from physim_drake.registration.trimmed_icp import TrimmedIcpConfig
from physim_drake.search.group_search import SearchConfig
from physim_drake.search.states import ExpansionConfig

LEAST_CONFIDENCE = 0.5
"""Of what is found with a method that searches, if not set: right poses have more."""


@dataclass(frozen=True)
class EstimationConfig:
    """Everything that can be set about an estimate.

    Attributes:
        method: way to estimate.
        seed: seed of all random choices.
        workers: number of processes; the result does not depend on it.
        search: budget and constants of the tree search.
        steps: settings of the steps that run in workers.
        min_segment_points: an object with fewer points is reported as not found.
        cost_tie_fraction: refined states whose fine costs differ by less than this
            share explain the image equally well; the one nearest to rest is taken.
        rest_tolerance_m: a state that moves by less until it rests is as good as at
            rest, m; true states, refined, move by up to 1.9 mm (95 % of 60 scenes).
        refine_within_fraction: a state with an object in another pose is refined if
            its fine cost exceeds the best state's by less than this share.
        rounds: searches of a group at most, later ones with new hypotheses for objects
            that the image does not confirm; 1 is the paper's way.
        confident_from: objects of at least this confidence are confirmed by the image,
            and not searched again.
        trusted_from: objects of less confidence take no points from another's new
            hypotheses; if all are wrong together, all begin anew.
        alternatives_below: an object that the detector is not sure of is also tried
            elsewhere if its confidence is less than this.
        least_confidence: an object that the image confirms by less is reported as not
            found; 0 reports all. None is `LEAST_CONFIDENCE` for a method that searches,
            and 0 for the others, which are there to be compared with.
    """

    method: Method = Method.PHYSIM_MCTS
    seed: int = 0
    workers: int = 1
    search: SearchConfig = field(default_factory=SearchConfig)
    steps: WorkerConfig = field(default_factory=WorkerConfig)
    min_segment_points: int = 30
    cost_tie_fraction: float = 0.01
    rest_tolerance_m: float = 0.002
    refine_within_fraction: float = 0.1
    rounds: int = 3
    confident_from: float = 0.93
    trusted_from: float = 0.7
    alternatives_below: float = 0.97
    least_confidence: float | None = None

    def __post_init__(self) -> None:
        if self.least_confidence is not None and not 0 <= self.least_confidence <= 1:
            raise InputError(
                "estimation",
                f"is {self.least_confidence:g}",
                "give a number from 0 to 1",
                "least_confidence",
            )

    @classmethod
    def paper(cls) -> EstimationConfig:
        """The paper's plain search: all expansions, one round, every pose reported.

        A fixed share of the points is trimmed; by default they are weighed instead.
        """
        trimmed = TrimmedIcpConfig(keep=0.7, soft=False, cutoff=0.01)
        return cls(
            search=SearchConfig(patience_per_object=math.inf),
            steps=WorkerConfig(expansion=ExpansionConfig(icp=trimmed)),
            rounds=1,
            least_confidence=0.0,
        )

    @property
    def required_confidence(self) -> float:
        """The confidence below which an object is not found with this method."""
        if self.least_confidence is not None:
            return self.least_confidence
        return LEAST_CONFIDENCE if self.method.searches else 0.0

    def with_budget(self, expansions: int, representatives: int) -> EstimationConfig:
        """The same with another size of the search and other numbers of hypotheses."""
        steps = self.steps
        clustering = replace(
            steps.hypotheses.clustering, representatives=representatives
        )
        hypotheses = replace(steps.hypotheses, clustering=clustering)
        return replace(
            self,
            search=replace(self.search, expansions=expansions),
            steps=replace(steps, hypotheses=hypotheses),
        )
