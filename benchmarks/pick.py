# SPDX-License-Identifier: MIT
"""Where a pick cell's time goes: python benchmarks/pick.py [EPISODES] [SCENARIO].

Wall time by stage, for a second of simulated time and for a pick: `simulation` is
Drake's, with contact and the systems in Python; `rendering` is the images and the
camera's errors; `estimation` hypotheses and search; `planning` the arm's motions;
`set-up` the scene, the diagram and its renderers, once an episode. The real-time factor
is simulated time over all of them together.
"""

from __future__ import annotations

import logging
import os
import sys
from pathlib import Path

from physim_drake.episodes.result import EpisodeResult, figures
from physim_drake.episodes.runner import EpisodeRunner
from physim_drake.picking.scenario import load_scenario

CLUTTER = Path(__file__).parents[1] / "examples" / "scenarios" / "clutter.yaml"


def main() -> None:
    """Runs episodes and prints the table."""
    episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 6
    scenario = load_scenario(Path(sys.argv[2]) if len(sys.argv) > 2 else CLUTTER)
    logging.getLogger("drake").setLevel(logging.ERROR)
    results: list[EpisodeResult] = []
    with EpisodeRunner(scenario) as runner:
        runner.run(episodes)  # compiles and loads what is then kept
        for episode in range(episodes):
            results.append(runner.run(episode))
    print_table(results)


def print_table(results: list[EpisodeResult]) -> None:
    """Prints wall time by stage."""
    total = figures(results)
    simulated, picks, wall = (
        total["simulated_time"],
        total["picks"],
        total["wall_time"],
    )
    print(f"{len(results)} episodes on {os.cpu_count()} cores, {picks} picks")
    print(f"{'stage':12} {'s':>8} {'share':>7} {'per s':>7} {'per pick':>9}")
    stages = sorted(total["stages"].items(), key=lambda item: -item[1])
    for stage, seconds in [*stages, ("all", wall)]:
        print(
            f"{stage:12} {seconds:8.1f} {seconds / wall:7.1%} "
            f"{seconds / simulated:7.2f} {seconds / max(picks, 1):9.2f}"
        )
    print(
        f"{simulated:.1f} s simulated, real-time factor "
        f"{total['real_time_factor']:.2f}; {total['cleared']} of {total['objects']} "
        "objects cleared"
    )


if __name__ == "__main__":
    main()
