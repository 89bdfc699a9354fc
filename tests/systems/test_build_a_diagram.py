# SPDX-License-Identifier: MIT
"""What docs/build-a-diagram.md says holds."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

import numpy as np
import yaml
from pydrake.geometry import Meshcat
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from physim_drake.observation.support_surface import SupportSurface
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from physim_drake.storage.typed_yaml import parse_typed_yaml
from physim_drake.systems import (
    AddPerceptionDiagram,
    OracleDetectorConfig,
    PerceptionConfig,
    Stamped,
)
from tests.systems.looks import build, shown
from tests.test_docs import ROOT, blocks

PAGE = ROOT / "docs" / "build-a-diagram.md"


def perception() -> Any:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.01)
    plant.Finalize()
    return AddPerceptionDiagram(
        builder,
        PerceptionConfig(detector=OracleDetectorConfig()),
        scene_graph,
        meshcat=Meshcat(),
    )


def ports(system: Any) -> tuple[set[str], set[str]]:
    inputs = (system.get_input_port(k) for k in range(system.num_input_ports()))
    outputs = (system.get_output_port(k) for k in range(system.num_output_ports()))
    return {p.get_name() for p in inputs}, {p.get_name() for p in outputs}


def test_the_program_shown_is_the_example() -> None:
    shown_program = blocks(PAGE, "python")[0]
    assert shown_program in (ROOT / "examples" / "perception_diagram.py").read_text()


def test_the_settings_shown_are_all_and_the_defaults() -> None:
    (text,) = blocks(PAGE, "yaml")
    config = parse_typed_yaml(text, PerceptionConfig)
    default = PerceptionConfig()
    plain = re.sub(r"!Rpy", "", text)
    keys = yaml.safe_load(plain)
    assert set(keys) == {f.name for f in dataclasses.fields(config)}
    for name, value in keys.items():
        nested = getattr(config, name)
        if dataclasses.is_dataclass(nested):
            assert set(value) == {f.name for f in dataclasses.fields(nested)}
    X_PB = default.camera.X_PB
    # An image size that is not given is the preset's.
    K = default.camera.intrinsics
    expected = dataclasses.replace(
        default.camera, X_PB=X_PB, width=K.width, height=K.height
    )
    camera = dataclasses.replace(config.camera, X_PB=X_PB)
    assert dataclasses.replace(config, camera=camera) == dataclasses.replace(
        default, camera=expected
    )


def test_the_ports_named_are_there() -> None:
    diagram = perception()
    systems = {type(s).__name__: ports(s) for s in diagram.GetSystems()}
    row = re.compile(r"^\| `(\w+)` \| (.*) \| (.*) \|$", re.MULTILINE)
    rows = row.findall(PAGE.read_text())
    assert len(rows) == 8
    for name, takes, makes in rows:
        if name == "ReplaySource":  # not in the diagram
            continue
        inputs, outputs = systems[name]
        assert set(re.findall(r"`([a-z_]+)`", takes)) <= inputs, name
        assert set(re.findall(r"`([a-z_]+)`", makes)) == outputs, name


def test_the_drawing_shows_every_system_and_port() -> None:
    drawing = (ROOT / "docs" / "perception_diagram.svg").read_text()
    diagram = perception()
    names = {s.get_name() for s in diagram.GetSystems()}
    assert len(names) == 9
    for name in names:
        assert f"name={name}<" in drawing
    for name in set.union(*ports(diagram)):
        assert f">{name}<" in drawing


def test_the_stage_shown_counts() -> None:
    namespace: dict[str, Any] = {"__name__": "page"}
    exec(compile(blocks(PAGE, "python")[3], PAGE.name, "exec"), namespace)
    counter = namespace["FoundCounter"]()
    found = ObjectEstimate(1, "a", np.eye(4), np.eye(4), 1.0, "")
    missing = ObjectEstimate(2, "b", None, None, 0.0, "hidden")
    surface = SupportSurface(np.eye(4), np.eye(4))
    estimate = SceneEstimate((found, missing, found), surface, "test", {})
    diagram = build(counter)
    context = diagram.CreateDefaultContext()
    inner = counter.GetMyMutableContextFromRoot(context)
    counter.GetInputPort("scene_estimate").FixValue(inner, Stamped(estimate, 0.0, 1))
    Simulator(diagram, context).AdvanceTo(0.5)
    assert shown(counter, context, "count").value == 2
