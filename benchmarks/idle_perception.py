# SPDX-License-Identifier: MIT
"""What perception costs a simulation while there is nothing to look at.

    python benchmarks/idle_perception.py [--seconds 2] [--repeats 5]

The example scene of three objects is simulated at 5 ms without perception, with stages
that look at their inputs in each step, and with stages that do so every 20 ms. Figures
are medians of the processor's microseconds a step.
"""

from __future__ import annotations

import statistics
import time
from pathlib import Path
from typing import Annotated

import typer
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from physim_drake.models import PACKAGE_XML
from physim_drake.systems import AddPerceptionDiagram, PerceptionConfig

SCENE = Path(__file__).parents[1] / "examples" / "perception" / "table.dmd.yaml"
STEP = 0.005
_REST = 1.0


def main(
    seconds: Annotated[float, typer.Option(help="Simulated, for each figure.")] = 2.0,
    repeats: int = 5,
) -> None:
    """Times the same simulation with and without perception."""
    cases = {
        "no perception": simulation(None),
        "each step": simulation(PerceptionConfig()),
        "every 20 ms": simulation(PerceptionConfig(poll_period=0.02)),
    }
    figures: dict[str, list[float]] = {name: [] for name in cases}
    for _ in range(repeats):  # in turns, so that other load meets all alike
        for name, simulator in cases.items():
            end = simulator.get_context().get_time() + seconds
            start = time.process_time()
            simulator.AdvanceTo(end)
            spent = time.process_time() - start
            figures[name].append(1e6 * spent * STEP / seconds)
    least = statistics.median(figures["no perception"])
    for name, values in figures.items():
        median = statistics.median(values)
        print(f"{name:14} {median:6.0f} us a step, {median - least:+5.0f}")


def simulation(config: PerceptionConfig | None) -> Simulator:
    """The scene at rest, and perception beside it that is not triggered."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(time_step=STEP, discrete_contact_approximation="sap"),
        builder,
    )
    parser = Parser(plant)
    parser.package_map().AddPackageXml(PACKAGE_XML)
    parser.AddModels(SCENE)
    plant.Finalize()
    perception = None
    if config is not None:
        perception = AddPerceptionDiagram(builder, config, scene_graph)
    simulator = Simulator(builder.Build())
    if perception is not None:
        context = perception.GetMyContextFromRoot(simulator.get_context())
        perception.GetInputPort("trigger").FixValue(context, 0.0)
    simulator.AdvanceTo(_REST)
    return simulator


if __name__ == "__main__":
    typer.run(main)
