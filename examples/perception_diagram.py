# SPDX-License-Identifier: MIT
"""Puts perception beside a plant: what is on the table, and how far off is that?

    python examples/perception_diagram.py

The scene and the settings are in examples/perception; docs/build-a-diagram.md explains.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from physim_drake.models import PACKAGE_XML
from physim_drake.systems import (
    AddPerceptionDiagram,
    DetectionAlgorithm,
    PerceptionConfig,
)

FOLDER = Path(__file__).parent / "perception"


def main(
    config: PerceptionConfig,
    scene: Path = FOLDER / "table.dmd.yaml",
    detector: DetectionAlgorithm | None = None,
) -> None:
    """Simulates a scene, looks at it once and prints what is seen."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(time_step=0.005, discrete_contact_approximation="sap"),
        builder,
    )
    parser = Parser(plant)
    parser.package_map().AddPackageXml(PACKAGE_XML)
    parser.AddModels(scene)
    plant.Finalize()

    with AddPerceptionDiagram(
        builder, config, scene_graph, detector=detector
    ) as perception:
        simulator = Simulator(builder.Build())
        context = perception.GetMyContextFromRoot(simulator.get_context())
        trigger = perception.GetInputPort("trigger")

        trigger.FixValue(context, 0.0)
        simulator.AdvanceTo(1.0)  # the objects come to rest
        trigger.FixValue(context, 1.0)
        simulator.AdvanceTo(1.1)  # a look, detections, hypotheses, estimate, errors

        estimate: Any = perception.GetOutputPort("scene_estimate").Eval(context)
        errors: Any = perception.GetOutputPort("pose_errors").Eval(context)
        print(estimate.value or estimate.error)
        print(errors.value[-1])


# More than one worker means processes, and those import this file again.
if __name__ == "__main__":
    main(PerceptionConfig.load(FOLDER / "perception.yaml"))
