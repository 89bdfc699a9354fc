# SPDX-License-Identifier: MIT
"""The cell's diagram, without running its task to the end."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from physim_drake.models import APC11
from physim_drake.picking.cell import (
    PickCellGeometry,
    PreparedCell,
    cell_geometry,
    load_objects,
)
from physim_drake.picking.initial_scene import PlacedModel
from physim_drake.picking.scenario import (
    DetectorName,
    LookConfig,
    ObjectsConfig,
    PickScenario,
)
from physim_drake.poses import make_pose
from physim_drake.scenes.generation import write_models
from physim_drake.systems.pick_cell import PickCell, perception_config

SCENARIO = PickScenario(
    objects=ObjectsConfig(str(APC11), ("dove_beauty_bar",), (1, 1), (1,)),
    look=LookConfig(detector=DetectorName.ORACLE),
)
SOAP = 9


@pytest.fixture(scope="module")
def prepared() -> PreparedCell:
    library = load_objects(SCENARIO)
    return PreparedCell(SCENARIO, library, cell_geometry(SCENARIO, library))


@pytest.fixture(scope="module")
def geometry(prepared: PreparedCell) -> PickCellGeometry:
    return prepared.geometry


@pytest.fixture(scope="module")
def soap(prepared: PreparedCell, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_models(prepared.library, tmp_path_factory.mktemp("models"))[SOAP]


@pytest.fixture
def cell(prepared: PreparedCell, soap: Path) -> Iterator[PickCell]:
    lowest = -float(prepared.library[SOAP].mesh.bounds[0, 2])
    X_WO = prepared.geometry.X_WA @ make_pose(p=[0.0, 0.0, lowest])
    cell = PickCell(prepared, [PlacedModel(SOAP, soap, X_WO)])
    yield cell
    cell.close()


def advance(cell: PickCell, time: float, context: Any = None) -> Any:
    simulator = Simulator(cell.diagram, context)
    simulator.AdvanceTo(time)
    return simulator.get_mutable_context()


def test_the_task_is_connected_to_estimates_and_to_nothing_true(
    cell: PickCell,
) -> None:
    names = {
        f"{system.get_name()}.{system.get_output_port(port).get_name()}"
        for (target, _), (system, port) in cell.diagram.connection_map().items()
        if target.get_name() == "pick_task"
    }
    assert names == {"perception.scene_estimate", "suction_gripper.vacuum"}


def test_robot_and_objects_rest_at_the_beginning(
    cell: PickCell, geometry: PickCellGeometry
) -> None:
    context = advance(cell, 0.4)
    plant = cell.plant
    plant_context = plant.GetMyContextFromRoot(context)
    planner = geometry.planner
    for name, angle in zip(planner.config.joints, planner.home, strict=True):
        joint = plant.GetJointByName(name)
        assert joint.get_angle(plant_context) == pytest.approx(angle, abs=1e-3)
    (instance,) = cell.instances
    body = plant.GetBodyByName("body", plant.GetModelInstanceByName(instance.name))
    X_WO = plant.EvalBodyPoseInWorld(plant_context, body)
    assert X_WO.translation()[:2] == pytest.approx(geometry.X_WA[:2, 3], abs=1e-3)


def test_the_arm_follows_its_reference(
    cell: PickCell, geometry: PickCellGeometry
) -> None:
    context = advance(cell, 1.0)  # on its way to the first viewpoint
    plant_context = cell.plant.GetMyContextFromRoot(context)
    motion = cell.task.task_state(cell.task.GetMyContextFromRoot(context)).motion
    # The plant's last step began a time step before.
    q, v = motion.reference(1.0 - SCENARIO.plant_config.time_step)
    joints = [cell.plant.GetJointByName(n) for n in geometry.planner.config.joints]
    measured = np.array([joint.get_angle(plant_context) for joint in joints])
    assert np.abs(v).max() > 0.1
    assert np.abs(measured - q).max() < 0.01


def test_planner_and_simulation_agree_where_the_camera_is(
    cell: PickCell, geometry: PickCellGeometry
) -> None:
    scene = geometry.planner.scene
    plant_context = cell.plant.GetMyContextFromRoot(advance(cell, 0.1))
    frame = cell.plant.GetFrameByName("optical")
    X_WC = frame.CalcPoseInWorld(plant_context).GetAsMatrix4()
    assert pytest.approx(scene.camera_pose(geometry.planner.home), abs=1e-3) == X_WC


def test_the_task_hears_of_all_that_it_might_pick(prepared: PreparedCell) -> None:
    estimation = perception_config(prepared, 0).estimator.estimation
    assert estimation.required_confidence == SCENARIO.task.last_confidence


def test_a_cloned_context_goes_on_as_the_original(cell: PickCell) -> None:
    context = advance(cell, 0.7)
    clone = context.Clone()
    positions = [
        cell.plant.GetPositions(
            cell.plant.GetMyContextFromRoot(advance(cell, 0.9, start))
        )
        for start in (context, clone)
    ]
    assert np.array_equal(positions[0], positions[1])
