# SPDX-License-Identifier: MIT
"""Draws the perception diagram: docs/perception_diagram.svg.

    python docs/draw_perception_diagram.py

Needs Graphviz's `dot` (apt-get install graphviz). The drawing is Drake's own.
"""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.framework import DiagramBuilder

from physim_drake.systems import AddPerceptionDiagram, PerceptionConfig

TARGET = Path(__file__).parent / "perception_diagram.svg"


def graph() -> str:
    """The diagram in Graphviz's language."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(MultibodyPlantConfig(), builder)
    plant.Finalize()
    perception = AddPerceptionDiagram(
        builder,
        PerceptionConfig(),
        scene_graph,
        meshcat=Meshcat(MeshcatParams(host="localhost")),
    )
    text = perception.GetGraphvizString(max_depth=1)
    return re.sub(r"physim_drake\.systems\.\w+\.", "", text)


if __name__ == "__main__":
    drawn = subprocess.run(
        ["dot", "-Tsvg"], input=graph(), capture_output=True, text=True, check=True
    )
    TARGET.write_text(drawn.stdout, encoding="utf-8")
    print(TARGET)
