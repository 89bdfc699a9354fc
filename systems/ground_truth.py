# SPDX-License-Identifier: MIT
"""The true poses of the objects of a plant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from physim_drake.poses import Array
from physim_drake.systems.object_instances import ObjectInstance
from physim_drake.systems.source import Source
from physim_drake.systems.stage import EACH_STEP, TimingConfig

TruePoses = Mapping[str, np.ndarray]
"""X_WO (4, 4) of each object, by the name of its model instance."""


class GroundTruthPoses(Source):
    """Tells the true poses of the objects: now, and at the moment of each look.

    .. pydrake_system::

        name: GroundTruthPoses
        input_ports:
        - trigger (optional with a period)
        - body_poses
        output_ports:
        - look_poses
        - true_poses

    Inputs: ``trigger`` see `Source`, to be the camera's; ``body_poses``
    (list[RigidTransform]) of the plant. Outputs: ``true_poses`` (Mapping[str, X_WO (4,
    4)], m, by the name of the model instance), as they are; ``look_poses`` (Stamped of
    such a mapping), as they were when the look was taken.

    Args:
        instances: the objects.
        period: see `Source`.
        timing: see `Source`.
    """

    def __init__(
        self,
        instances: Sequence[ObjectInstance],
        period: float | None = None,
        timing: TimingConfig = EACH_STEP,
    ) -> None:
        super().__init__({"look_poses": TruePoses}, period, timing)
        self._instances = tuple(instances)
        self._poses: Any = self.DeclareAbstractInputPort(
            "body_poses", Value[list[RigidTransform]]()
        )
        self.DeclareAbstractOutputPort(
            "true_poses", lambda: Value({}), self._show_poses, {self._poses.ticket()}
        )

    def capture(self, context: Context, number: int) -> tuple[Any, ...]:
        """The poses as they are at a look."""
        return (self._X_WO(context),)

    def _show_poses(self, context: Any, output: Any) -> None:
        output.set_value(self._X_WO(context))

    def _X_WO(self, context: Context) -> dict[str, Array]:
        X_WB = self._poses.Eval(context)
        return {i.name: X_WB[i.body_index].GetAsMatrix4() for i in self._instances}
