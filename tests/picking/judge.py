# SPDX-License-Identifier: MIT
"""A small cell with the SDA10F, and a plant of its own that judges plans in it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import (
    LoadModelDirectivesFromString,
    ModelDirective,
    ModelDirectives,
    ProcessModelDirectives,
)
from pydrake.planning import RobotDiagramBuilder

from physim_drake.models import PACKAGE_XML
from physim_drake.objects.model import ObjectLibrary, ObjectModel
from physim_drake.objects.sdformat import write_drake_model
from physim_drake.observation.support_surface import SupportSurface
from physim_drake.picking.planner_config import ArmPlannerConfig, HeldObject
from physim_drake.poses import Array, make_pose
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from tests import synthetic

TABLE_HEIGHT = 0.75
WALL = 90
WALL_SIZE = (0.30, 0.02, 0.30)
_CELL = f"""
directives:
- add_directives:
    file: package://physim_drake_models/motoman_sda10f/sda10f_with_tools.dmd.yaml
- add_frame:
    name: table_top
    X_PF: {{base_frame: world, translation: [1.3, 0, {TABLE_HEIGHT}]}}
- add_model:
    name: table
    file: package://physim_drake_models/table/table.sdf
- add_weld: {{parent: table_top, child: "table::body"}}
"""


def cell() -> tuple[ModelDirective, ...]:
    """The robot with its tools, before a table."""
    return tuple(LoadModelDirectivesFromString(_CELL).directives)


def library() -> ObjectLibrary:
    """A few objects, and a wall that stands on its edge."""
    wall = ObjectModel.from_mesh(WALL, "wall", trimesh.creation.box(WALL_SIZE))
    few = (synthetic.SOAP, synthetic.ERASER, synthetic.TISSUES, synthetic.BALL)
    return ObjectLibrary([*(synthetic.library()[i] for i in few), wall], "test")


def on_table(X: Array, x: float = 0.6, y: float = 0.2) -> Array:
    """The pose of what is at X on a table at the origin, on the cell's table."""
    return make_pose(p=[x, y, TABLE_HEIGHT]) @ X


def wall_at(x: float, y: float) -> tuple[int, Array]:
    """A wall along x, 30 cm high, standing on the table."""
    return WALL, make_pose(p=[x, y, TABLE_HEIGHT + WALL_SIZE[2] / 2])


def estimate_of(
    objects: Sequence[tuple[int, Array]], models: ObjectLibrary
) -> SceneEstimate:
    """An estimate that found these objects, each with its X_WO."""
    return SceneEstimate(
        tuple(ObjectEstimate(i, models[i].name, X, X, 0.9, "") for i, X in objects),
        SupportSurface(np.eye(4), np.eye(4)),
        "physim-mcts",
        {},
    )


class Judge:
    """Says how near the robot comes to what, from files and not from the planner.

    Args:
        objects: what stands in the cell, with X_WO.
        models: their models.
        folder: for their files.
        config: names of the planned joints.
        held: an object at the cup; it must not be among `objects`.
    """

    def __init__(
        self,
        objects: Sequence[tuple[int, Array]],
        models: ObjectLibrary,
        folder: Path,
        config: ArmPlannerConfig,
        held: HeldObject | None = None,
    ) -> None:
        builder = RobotDiagramBuilder(time_step=0.0)
        plant, parser = builder.plant(), builder.parser()
        parser.package_map().AddPackageXml(str(PACKAGE_XML))
        parser.SetAutoRenaming(True)
        ProcessModelDirectives(ModelDirectives(directives=list(cell())), parser)
        self._environment = {"table"}
        cup = plant.GetFrameByName("cup")
        for object_id, X in objects:
            name = self._add(plant, parser, models[object_id], folder, X, None)
            self._environment.add(name)
        self.held_name = ""
        if held is not None:
            model = models[held.object_id]
            self.held_name = self._add(plant, parser, model, folder, held.X_GO, cup)
        plant.Finalize()
        self._diagram: Any = builder.Build()
        self._plant: Any = self._diagram.plant()
        self._root = self._diagram.CreateDefaultContext()
        self._context = self._plant.GetMyContextFromRoot(self._root)
        self._joints = [plant.GetJointByName(name) for name in config.joints]
        for name, angle in config.other_joints.items():
            self._plant.GetJointByName(name).set_angle(self._context, angle)

    @staticmethod
    def _add(
        plant: Any, parser: Any, model: ObjectModel, folder: Path, X: Array, frame: Any
    ) -> str:
        (instance,) = parser.AddModels(write_drake_model(model, folder / model.name))
        body = plant.GetBodyByName("body", instance).body_frame()
        parent = plant.world_frame() if frame is None else frame
        plant.WeldFrames(parent, body, RigidTransform(X))
        return str(plant.GetModelInstanceName(instance))

    def put(self, q: Array) -> None:
        """Moves the planned joints."""
        for joint, angle in zip(self._joints, q, strict=True):
            joint.set_angle(self._context, angle)

    def pose(self, frame: str, q: Array) -> Array:
        """X_WF of a frame, (4, 4)."""
        self.put(q)
        found = self._plant.GetFrameByName(frame).CalcPoseInWorld(self._context)
        return np.asarray(found.GetAsMatrix4())

    def distances(self, q: Array) -> dict[tuple[str, str], float]:
        """What is within 3 cm, m: (body of the robot, model in the cell, or body)."""
        self.put(q)
        graph = self._diagram.scene_graph()
        query = graph.get_query_output_port().Eval(
            graph.GetMyContextFromRoot(self._root)
        )
        inspector = query.inspector()
        near: dict[tuple[str, str], float] = {}
        for pair in query.ComputeSignedDistancePairwiseClosestPoints(0.03):
            bodies = [
                self._plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
                for geometry in (pair.id_A, pair.id_B)
            ]
            models = [
                str(self._plant.GetModelInstanceName(b.model_instance()))
                for b in bodies
            ]
            still = [model in self._environment for model in models]
            if all(still):
                continue
            if still[0]:
                bodies, models, still = bodies[::-1], models[::-1], still[::-1]
            other = models[1] if still[1] else str(bodies[1].name())
            mine = self.held_name if models[0] == self.held_name else bodies[0].name()
            key = (str(mine), other)
            near[key] = min(near.get(key, np.inf), pair.distance)
        return near
