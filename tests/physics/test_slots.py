# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia, default_model_instance

from physim_drake.physics.slots import add_slot


def test_a_body_is_parked_until_it_is_placed() -> None:
    plant = MultibodyPlant(0.0)
    inertia = SpatialInertia.SolidSphereWithMass(1.0, 0.1)
    parked = RigidTransform([0.0, 0.0, -9.0])
    slot = add_slot(
        plant, "a", default_model_instance(), inertia, plant.world_frame(), parked
    )
    plant.Finalize()
    context = plant.CreateDefaultContext()
    assert plant.num_positions() == 0
    for X in (parked, RigidTransform([1.0, 2.0, 3.0])):
        slot.place(context, X)
        pose = plant.EvalBodyPoseInWorld(context, slot.body)
        np.testing.assert_allclose(pose.translation(), X.translation())
