# SPDX-License-Identifier: MIT
"""Objects of any size, with a surface that carries them and without one."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from physim_drake.camera import CameraIntrinsics
from physim_drake.datasets.bop import BopDataset
from physim_drake.estimation.estimator import EstimationConfig, PoseEstimator
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary, ObjectModel
from physim_drake.objects.symmetry import detect_symmetry
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.pose_errors import mssd, symmetry_samples
from physim_drake.poses import Array, inverse, make_pose
from physim_drake.rendering.depth import DepthRenderer
from physim_drake.scene_estimate import SceneEstimate
from physim_drake.search.group_search import SearchConfig
from physim_drake.search.states import composite
from tests.synthetic import look_at, mask_box, noisy, plane_depth, turned

CAMERA = CameraIntrinsics(640, 480, 600.0, 600.0, 319.5, 239.5)
QUICK = EstimationConfig(search=SearchConfig(expansions=40))


def of_cases(
    case: Path, masks: bool = False, models: Path | None = None
) -> tuple[SceneEstimate, list[float]]:
    """The estimate of a field case's image, and the error of each true pose, mm."""
    data = BopDataset(case, "test", models)
    library = ObjectLibrary.load(data.models, {t.object_id for t in data.targets()})
    (image,) = data.images()
    detections = data.masks(*image) if masks else data.detections(*image)
    detections = [d for d in detections if d.object_id in library]
    with PoseEstimator(library, QUICK) as estimator:
        estimate = estimator.estimate(data.observation(*image), detections)
    truth = [(t.object_id, t.X_CO) for t in data.ground_truth(*image)]
    return estimate, errors(estimate, library, truth)


def errors(
    estimate: SceneEstimate, library: ObjectLibrary, truth: list[tuple[int, Array]]
) -> list[float]:
    """Farthest that a corner of each object is off in the nearest estimate of it, mm.

    Poses that the shape cannot tell apart are equal.
    """
    return [
        1e3
        * min(
            (
                shape_error(library[i], X_true, o.X_CO)
                for o in estimate.objects
                if o.object_id == i and o.X_CO is not None
            ),
            default=math.inf,
        )
        for i, X_true in truth
    ]


def shape_error(model: ObjectModel, X_true: Array, X: Array) -> float:
    samples = symmetry_samples(detect_symmetry(model.mesh), X_true, X)
    return mssd(np.asarray(model.mesh.vertices), X_true, X, samples)


def test_two_nuts_are_found_within_a_millimetre(shared: Path) -> None:
    _, found = of_cases(shared / "data/field-cases/small-nut")
    assert max(found) < 1


def test_a_large_box_far_away_is_found(shared: Path) -> None:
    _, found = of_cases(shared / "data/field-cases/large-box")
    assert max(found) < 10


@pytest.mark.parametrize("masks", [True, False])
@pytest.mark.parametrize("case", ["held-in-air", "table-removed"])
def test_objects_that_nothing_carries_are_found(
    shared: Path, case: str, masks: bool
) -> None:
    estimate, found = of_cases(shared / "data/field-cases" / case, masks)
    assert max(found) < 2
    assert "no support surface" in estimate.warning
    assert not estimate.surface.known


def test_a_world_that_is_the_camera_is_doubted(shared: Path) -> None:
    case = shared / "data/field-cases/camera-is-world"
    estimate, found = of_cases(case, models=APC11)
    assert max(found) < 3
    assert estimate.warning.count("cam_R_w2c") == 1


def box_on_the_floor(
    size: tuple[float, float, float], distance: float, noise: float
) -> tuple[RgbdObservation, ObjectLibrary, Detection, Array]:
    """A box that lies on a plane, seen from above at a slant; its true pose in C."""
    mesh = trimesh.creation.box(size)
    library = ObjectLibrary([ObjectModel.from_mesh(1, "box", mesh)], "boxes")
    X_WC = look_at([0.0, -0.6 * distance, 0.8 * distance], [0.0, 0.0, 0.0])
    X_CO = inverse(X_WC) @ make_pose(turned("z", 25), [0.0, 0.0, size[2] / 2])
    drawn = DepthRenderer(library, CAMERA).render(1, X_CO)
    floor = plane_depth(CAMERA, X_WC, [0.0, 0.0, 1.0], 0.0)
    depth = composite(floor, drawn)
    mask = (drawn > 0) & (drawn == depth)
    observation = RgbdObservation(noisy(depth, noise, 0), CAMERA, None, X_WC)
    return observation, library, Detection(1, mask_box(mask)), X_CO


@pytest.mark.parametrize(
    ("size", "distance", "noise", "limit"),
    [
        ((0.15, 0.10, 0.002), 0.5, 0.1, 2.0),
        ((1.2, 0.8, 0.15), 4.0, 0.5, 20.0),
        ((0.02, 0.012, 0.008), 0.3, 0.2, 1.0),
    ],
    ids=["sheet of 2 mm", "pallet of 1.2 m", "block of 2 cm"],
)
def test_boxes_of_all_sizes_are_found(
    size: tuple[float, float, float], distance: float, noise: float, limit: float
) -> None:
    observation, library, detection, X_CO = box_on_the_floor(size, distance, noise)
    with PoseEstimator(library, QUICK) as estimator:
        estimate = estimator.estimate(observation, [detection])
    assert estimate.warning == ""
    assert max(errors(estimate, library, [(1, X_CO)])) < limit


def test_hypotheses_of_a_small_object_are_given_in_its_own_size() -> None:
    observation, library, detection, X_CO = box_on_the_floor(
        (0.02, 0.012, 0.008), 0.3, 0
    )
    with PoseEstimator(library, QUICK) as estimator:
        prepared = estimator.prepare(observation, [detection])
        (hypotheses,) = estimator.hypotheses(prepared)
        records = []
        estimator.estimate_prepared(prepared, [hypotheses], records.append)
    for X_SO in (hypotheses.poses[0], records[0].result.states[0].poses[0]):
        shift = (prepared.segmented.X_CS @ X_SO)[:3, 3] - X_CO[:3, 3]
        assert np.linalg.norm(shift) < 0.005


def test_a_surface_that_is_said_to_be_none_is_not_looked_for() -> None:
    observation, library, detection, X_CO = box_on_the_floor(
        (0.15, 0.1, 0.05), 0.6, 0.3
    )
    with PoseEstimator(library, QUICK) as estimator:
        estimate = estimator.estimate(
            replace(observation, X_WC=None), [detection], -math.inf
        )
    assert estimate.warning.startswith("no support surface: nothing carries")
    assert max(errors(estimate, library, [(1, X_CO)])) < 2
    (item,) = estimate.objects
    assert item.X_WO is not None
    assert item.X_CO is not None
    np.testing.assert_allclose(item.X_WO, item.X_CO, atol=1e-9)
