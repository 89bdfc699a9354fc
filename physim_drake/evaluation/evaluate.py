# SPDX-License-Identifier: MIT
"""Evaluates results against the ground truth of a dataset."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from physim_drake.camera import CameraIntrinsics
from physim_drake.datasets.bop import BopDataset, GroundTruthPose, ImageId, Target
from physim_drake.datasets.results import ResultRow
from physim_drake.errors import InputError
from physim_drake.evaluation.matching import (
    match_objects,
    origin_distances,
    visible_instances,
)
from physim_drake.evaluation.report import EvaluationReport, InstanceErrors
from physim_drake.evaluation.visible_surface import RenderDepth, SceneDistances, vsd
from physim_drake.objects.library_files import BOP_FILE, find_objects
from physim_drake.objects.model import ObjectLibrary
from physim_drake.pose_errors import (
    add_s,
    mspd,
    mssd,
    pose_error,
    symmetry_samples,
)
from physim_drake.poses import Array, SymmetryGroup

MakeRenderer = Callable[[CameraIntrinsics], RenderDepth]

ACCEPTED_ANGLE = np.radians(5.0)
ACCEPTED_DISTANCE = 0.01
ADD_S_DIAMETERS = 0.1
ADD_S_POINTS = 2000
DIAMETER_THRESHOLDS = np.linspace(0.05, 0.5, 10)
"""Thresholds of VSD (a fraction) and MSSD (in diameters), BOP challenge 2019."""
MSPD_THRESHOLDS = np.arange(5.0, 51.0, 5.0)
"""Thresholds of MSPD in an image that is 640 pixels wide, px."""


def evaluate_results(
    dataset: BopDataset,
    results: Sequence[ResultRow],
    library: ObjectLibrary,
    make_renderer: MakeRenderer | None = None,
    progress: Callable[[int], object] = lambda done: None,
) -> EvaluationReport:
    """Compares estimates with the true poses of the dataset's targets.

    Of each object and image the `inst_count` estimates with the highest scores are
    taken. They are matched one to one with the visible true poses so that the distances
    add up to the least; see `physim_drake.evaluation.matching`. Symmetries are those of
    models_info.json if the models folder has one (an object without an entry there has
    no symmetry), else the library's.

    Args:
        dataset: dataset with ground truth.
        results: estimates, in any order; those of other images or objects are only
            counted.
        library: models of the objects.
        make_renderer: function that returns a renderer for a camera; if it is None,
            VSD is left out.
        progress: function that is called with the number of targets done.

    Raises:
        InputError: if an image has targets but no ground truth, or the library
            lacks an object.
    """
    judge = _Judge(dataset, library, make_renderer)
    targets = dataset.targets()
    by_target: dict[tuple[int, int, int], list[ResultRow]] = {}
    times: dict[ImageId, float | None] = {(t.scene_id, t.im_id): None for t in targets}
    for row in results:
        image = (row.scene_id, row.im_id)
        by_target.setdefault((*image, row.object_id), []).append(row)
        if image in times and row.time is not None:
            times[image] = max(times[image] or 0.0, row.time)
    errors: list[InstanceErrors] = []
    for done, target in enumerate(targets, 1):
        key = (target.scene_id, target.im_id, target.object_id)
        errors += judge.judge(target, by_target.pop(key, []))
        progress(done)
    unused = sum(len(rows) for rows in by_target.values())
    return EvaluationReport.of(errors, list(times.values()), unused)


@dataclass(frozen=True)
class _Geometry:
    """What the error measures need of an object; lengths in m."""

    symmetry: SymmetryGroup
    diameter: float
    points: Array
    vertices: Array
    hull_vertices: Array


class _Judge:
    """Evaluates target by target, and keeps what the next one may need again."""

    def __init__(
        self,
        dataset: BopDataset,
        library: ObjectLibrary,
        make_renderer: MakeRenderer | None,
    ) -> None:
        self._dataset, self._library = dataset, library
        self._make_renderer = make_renderer
        self._geometries: dict[int, _Geometry] = {}
        self._renderer: tuple[CameraIntrinsics, RenderDepth] | None = None
        self._scene: tuple[ImageId, SceneDistances] | None = None
        self._symmetries: dict[int, SymmetryGroup] | None = None
        if (dataset.models / BOP_FILE).is_file():
            self._symmetries = {
                entry.object_id: entry.symmetry or SymmetryGroup()
                for entry in find_objects(dataset.models)
            }

    def judge(
        self, target: Target, estimates: Sequence[ResultRow]
    ) -> list[InstanceErrors]:
        """Errors of each true instance of the target."""
        image = (target.scene_id, target.im_id)
        poses = self._dataset.ground_truth(*image)
        true = visible_instances(poses, target.object_id, target.count)
        if not true:
            raise InputError(
                self._dataset.root,
                f"has no true pose of object {target.object_id} in scene {image[0]}, "
                f"image {image[1]}",
                "results can only be evaluated if there is a scene_gt.json",
            )
        rows = sorted(estimates, key=lambda row: -row.score)[: target.count]
        matches = match_objects(
            [target.object_id] * len(true),
            [target.object_id] * len(rows),
            origin_distances([poses[k].X_CO for k in true], [r.X_CO for r in rows]),
        )
        matched = dict(zip(true, matches, strict=True))
        # More instances may be visible than the target asks for; any of them will do.
        counted = sorted(true, key=lambda k: matched[k] is None)[: target.count]
        errors = []
        for index in sorted(counted):
            pose, best = poses[index], matched[index]
            missed = InstanceErrors(*image, target.object_id, index, pose.level)
            if self._make_renderer is not None:
                missed = replace(missed, vsd_recall=0.0)
            if best is None:
                errors.append(missed)
                continue
            claimed = replace(missed, confidence=rows[best].score)
            errors.append(self._compare(claimed, pose, rows[best].X_CO))
        return errors

    def _compare(
        self, missed: InstanceErrors, true: GroundTruthPose, X_CO: Array
    ) -> InstanceErrors:
        geometry = self._geometry(true.object_id)
        intrinsics = self._dataset.intrinsics(missed.scene_id, missed.im_id)
        error = pose_error(true.X_CO, X_CO, geometry.symmetry)
        nearest = add_s(geometry.points, true.X_CO, X_CO)
        X_OS = symmetry_samples(geometry.symmetry, true.X_CO, X_CO)
        surface = mssd(geometry.hull_vertices, true.X_CO, X_CO, X_OS)
        pixels = mspd(geometry.vertices, true.X_CO, X_CO, X_OS, intrinsics)
        mspd_thresholds = MSPD_THRESHOLDS * intrinsics.width / 640
        return replace(
            missed,
            found=True,
            rotation_deg=float(np.degrees(error.rpy_mean)),
            geodesic_deg=float(np.degrees(error.geodesic)),
            translation_cm=error.translation * 100,
            accepted=error.within(ACCEPTED_ANGLE, ACCEPTED_DISTANCE),
            add_s_cm=nearest * 100,
            add_s_accepted=nearest < ADD_S_DIAMETERS * geometry.diameter,
            mssd_cm=surface * 100,
            mspd_px=pixels,
            vsd_recall=self._vsd_recall(missed, true, X_CO, intrinsics),
            mssd_recall=float(
                np.mean(surface < DIAMETER_THRESHOLDS * geometry.diameter)
            ),
            mspd_recall=float(np.mean(pixels < mspd_thresholds)),
        )

    def _vsd_recall(
        self,
        missed: InstanceErrors,
        true: GroundTruthPose,
        X_CO: Array,
        intrinsics: CameraIntrinsics,
    ) -> float | None:
        """Fraction of (tolerance, threshold) pairs met; None without a renderer."""
        if self._make_renderer is None:
            return None
        if self._renderer is None or self._renderer[0] != intrinsics:
            self._renderer = (intrinsics, self._make_renderer(intrinsics))
        image = (missed.scene_id, missed.im_id)
        if self._scene is None or self._scene[0] != image:
            depth = self._dataset.observation(*image).depth
            self._scene = (image, SceneDistances.from_depth(depth, intrinsics))
        render = self._renderer[1].render
        discrepancy = vsd(
            self._scene[1],
            render(true.object_id, true.X_CO),
            render(true.object_id, X_CO),
            self._geometry(true.object_id).diameter,
        )
        return float(np.mean(discrepancy[:, None] < DIAMETER_THRESHOLDS))

    def _geometry(self, object_id: int) -> _Geometry:
        if object_id not in self._geometries:
            model = self._library[object_id]
            symmetry = model.symmetry
            if self._symmetries is not None:
                symmetry = self._symmetries.get(object_id, symmetry)
            self._geometries[object_id] = _Geometry(
                symmetry,
                model.diameter,
                model.surface_sample(ADD_S_POINTS)[0],
                np.asarray(model.mesh.vertices, dtype=float),
                np.asarray(model.mesh.convex_hull.vertices, dtype=float),
            )
        return self._geometries[object_id]
