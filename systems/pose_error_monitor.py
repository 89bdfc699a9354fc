# SPDX-License-Identifier: MIT
"""Compares each estimate with the truth, and remembers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from physim_drake.evaluation.matching import (
    ObjectError,
    ObjectPose,
    object_errors,
    poses_in_world,
)
from physim_drake.objects.model import ObjectLibrary
from physim_drake.scene_estimate import SceneEstimate
from physim_drake.systems.ground_truth import TruePoses
from physim_drake.systems.object_instances import ObjectInstance
from physim_drake.systems.stage import EACH_STEP, Look, Stage, TimingConfig


@dataclass(frozen=True)
class LookErrors:
    """The errors of one look's estimate.

    Attributes:
        number: number of the look.
        time: time at which it was taken, s.
        objects: one for each true object, in the plant's order; empty on error.
        error: why there is no estimate; empty if there is one.
    """

    number: int
    time: float
    objects: tuple[ObjectError, ...]
    error: str = ""

    def __str__(self) -> str:
        lines = [f"look {self.number} at {self.time:.3f} s: {self.error}".rstrip(": ")]
        return "\n".join(lines + [f"  {error}" for error in self.objects])


class PoseErrorMonitor(Stage):
    """Keeps the symmetry-aware errors of all looks.

    .. pydrake_system::

        name: PoseErrorMonitor
        input_ports:
        - scene_estimate
        - look_poses
        output_ports:
        - pose_errors

    Inputs: ``scene_estimate`` (Stamped[SceneEstimate]), ``look_poses`` (Stamped of a
    mapping from instance to X_WO (4, 4), m, see `GroundTruthPoses`). Output:
    ``pose_errors`` (Stamped[tuple[LookErrors, ...]]), rad and m, of all looks so far;
    a look without an estimate is in it, with its error. State: the same.

    Args:
        library: the objects.
        instances: which of them are there.
        timing: latency and poll period.
    """

    def __init__(
        self,
        library: ObjectLibrary,
        instances: Sequence[ObjectInstance],
        timing: TimingConfig = EACH_STEP,
    ) -> None:
        super().__init__(
            {"scene_estimate": SceneEstimate, "look_poses": TruePoses},
            {"pose_errors": tuple[LookErrors, ...]},
            timing,
            takes_errors=True,
        )
        self._library = library
        self._ids = {instance.name: instance.object_id for instance in instances}

    def work(self, look: Look) -> tuple[Any, ...]:
        """Adds the errors of a look."""
        objects: tuple[ObjectError, ...] = ()
        if not look.error:
            true = [
                ObjectPose(name, self._ids[name], X_WO)
                for name, X_WO in look["look_poses"].items()
            ]
            found = poses_in_world(look["scene_estimate"])
            objects = object_errors(found, true, self._library)
        errors = LookErrors(look.number, look.time, objects, look.error)
        return ((*(look.last[0].value or ()), errors),)
