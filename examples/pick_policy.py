# SPDX-License-Identifier: MIT
"""Picks by a policy of one's own: the tallest object first, wherever it stands.

python examples/pick_policy.py [EPISODE]

A policy has one method. It is given the estimated scene, the objects' models and what
holds for every candidate, and returns candidates, best first.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from physim_drake.episodes.runner import EpisodeRunner
from physim_drake.objects import ObjectLibrary
from physim_drake.picking.policy import (
    PickCandidate,
    PickConditions,
    object_candidates,
)
from physim_drake.picking.scenario import load_scenario
from physim_drake.picking.surroundings import PlacedObject, placed_objects
from physim_drake.poses import transform_points
from physim_drake.scene_estimate import SceneEstimate
from physim_drake.systems.pick_cell import PickCellParts

SCENARIO = Path(__file__).parent / "scenarios" / "clutter.yaml"


class TallestFirst:
    """Takes what reaches highest first."""

    def order(
        self,
        estimate: SceneEstimate,
        library: ObjectLibrary,
        conditions: PickConditions = PickConditions(),  # noqa: B008 (frozen)
    ) -> Sequence[PickCandidate]:
        """The candidates of the highest object, then of the next, and so on."""
        placed = placed_objects(estimate, library)
        return [
            candidate
            for target in sorted(placed, key=top, reverse=True)
            if target.index not in conditions.skip
            for candidate in object_candidates(target, placed, conditions)
        ]


def top(item: PlacedObject) -> float:
    """Height of an object's highest point, m."""
    return float(transform_points(item.X_WO, item.model.mesh.vertices)[:, 2].max())


def main(scenario: Path = SCENARIO, episode: int = 0) -> None:
    """Runs an episode and prints what was picked, in which order."""
    parts = PickCellParts(policy=TallestFirst())
    with EpisodeRunner(load_scenario(scenario), parts) as runner:
        result = runner.run(episode)
    for event in result.events:
        print(f"{event.time:6.2f} s  {event.kind}: {event.text}")
    print(f"{result.cleared} of {len(result.objects)} objects cleared")


if __name__ == "__main__":
    main(episode=int(sys.argv[1]) if len(sys.argv) > 1 else 0)
