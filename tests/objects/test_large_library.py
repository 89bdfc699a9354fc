# SPDX-License-Identifier: MIT
"""A library of a hundred objects costs nothing for those that are not looked for."""

from __future__ import annotations

from pathlib import Path
from unittest import mock

import numpy as np
import trimesh

from physim_drake.estimation.estimator import PoseEstimator
from physim_drake.estimation.workers import Worker, WorkerConfig
from physim_drake.objects.model import ObjectLibrary, ObjectModel
from physim_drake.poses import SymmetryGroup
from tests.synthetic import ERASER, SOAP, library, stack, synthesize

EXTRA = 100


def hundred_and_two() -> ObjectLibrary:
    box = trimesh.creation.box((0.05, 0.08, 0.12))
    others = [
        ObjectModel.from_mesh(1000 + k, f"box_{k}", box, symmetry=SymmetryGroup())
        for k in range(EXTRA)
    ]
    return ObjectLibrary([library()[ERASER], library()[SOAP], *others], "large")


def test_only_objects_of_the_scene_are_prepared() -> None:
    asked: set[str] = set()
    sample = ObjectModel.surface_sample

    def noted(self: ObjectModel, count: int, seed: int = 0) -> object:
        asked.add(self.name)
        return sample(self, count, seed)

    many = hundred_and_two()
    made = synthesize(stack())
    worker = Worker(many, WorkerConfig())
    with mock.patch.object(ObjectModel, "surface_sample", noted):
        worker.set_scene(made.scene())
        worker.unrest({0: made.X_SO[0], 1: made.X_SO[1]})
        worker.refine({0: made.X_SO[0], 1: made.X_SO[1]})
    assert asked <= {many[ERASER].name, many[SOAP].name}
    assert not any("collision_pieces" in vars(many[1000 + k]) for k in range(EXTRA))
    PoseEstimator(many).close()


def test_only_objects_asked_for_are_read(tmp_path: Path) -> None:
    lines = ["objects:"]
    for k in range(1, EXTRA + 1):
        lines.append(f"- {{id: {k}, name: box_{k}, mesh: box_{k}.ply}}")
    (tmp_path / "library.yaml").write_text("\n".join(lines))
    for k in (7, 93):
        trimesh.creation.box(np.array([0.05, 0.08, 0.12])).export(
            tmp_path / f"box_{k}.ply"
        )
    assert ObjectLibrary.load(tmp_path, {7, 93}).ids == (7, 93)
