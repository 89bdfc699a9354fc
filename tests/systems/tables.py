# SPDX-License-Identifier: MIT
"""A plant with a table and objects on it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydrake.common.schema import Transform
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.framework import DiagramBuilder

from physim_drake.models import APC11
from physim_drake.objects.containers import ContainerName, load_container
from physim_drake.poses import Array
from tests.synthetic import ERASER, SOAP, look_at, resting, turned

X_WC = look_at([0.05, -0.45, 0.55], [0.0, 0.0, 0.02])
SOAP_NAME, ERASER_NAME = "dove_beauty_bar", "expo_dry_erase_board_eraser"


def soap_and_eraser() -> dict[str, Array]:
    """X_WO of two objects that lie on the table, apart from each other."""
    return {
        SOAP_NAME: resting(SOAP, turned("yz", 90, 60), 0.08, 0.02),
        ERASER_NAME: resting(ERASER, turned("z", 20), -0.08, 0.0),
    }


def camera_transform() -> Transform:
    """Where the camera is, as a configuration has it."""
    return Transform(RigidTransform(X_WC))


def add_table(
    builder: DiagramBuilder,
    X_WO: Mapping[str, Array],
    models: Mapping[str, str] | None = None,
    time_step: float = 0.005,
) -> tuple[Any, Any]:
    """Adds a finalized plant and its scene graph.

    Args:
        builder: gets them.
        X_WO: where each model instance is at first.
        models: model of each instance of another name than its model's.
        time_step: of the plant, s.
    """
    config = MultibodyPlantConfig(
        time_step=time_step, discrete_contact_approximation="sap"
    )
    plant, scene_graph = AddMultibodyPlant(config, builder)
    parser = Parser(plant)
    parser.SetAutoRenaming(True)
    (table,) = parser.AddModels(load_container(ContainerName.TABLE).sdf)
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("body", table))
    for name, X in X_WO.items():
        model = (models or {}).get(name, name)
        (instance,) = parser.AddModels(APC11 / model / f"{model}.sdf")
        plant.RenameModelInstance(instance, name)
        body = plant.GetBodyByName("body", instance)
        plant.SetDefaultFloatingBaseBodyPose(body, RigidTransform(X))
    plant.Finalize()
    return plant, scene_graph
