# SPDX-License-Identifier: MIT
"""Bodies that are placed by a parameter of the context.

A body that is welded to a frame whose pose is a parameter can be put anywhere in
microseconds, without a joint and without building the plant again. While it is not
needed it is parked far away.
"""

from __future__ import annotations

from dataclasses import dataclass

from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Frame,
    ModelInstanceIndex,
    RigidBody,
    SpatialInertia,
)
from pydrake.systems.framework import Context


@dataclass(frozen=True)
class Slot:
    """A body on a frame that can be moved.

    Attributes:
        frame: frame whose pose in its parent is a parameter.
        body: body welded to it.
    """

    frame: FixedOffsetFrame
    body: RigidBody

    def place(self, context: Context, X_PB: RigidTransform) -> None:
        """Sets the body's pose in the parent frame, in a context of the plant."""
        self.frame.SetPoseInParentFrame(context, X_PB)


def add_slot(
    plant: MultibodyPlant,
    name: str,
    instance: ModelInstanceIndex,
    inertia: SpatialInertia,
    parent: Frame,
    X_parked: RigidTransform,
) -> Slot:
    """Adds a body without geometry, parked.

    Args:
        plant: plant, not finalized.
        name: name of the body; the frame is called `<name>_slot`.
        instance: model instance of both.
        inertia: inertia of the body.
        parent: frame that it is placed in.
        X_parked: pose in the parent frame until it is placed.
    """
    # The plant keeps a copy, which is what it returns.
    frame = plant.AddFrame(FixedOffsetFrame(f"{name}_slot", parent, X_parked, instance))
    body: RigidBody = plant.AddRigidBody(name, instance, inertia)
    plant.WeldFrames(frame, body.body_frame())
    return Slot(frame, body)
