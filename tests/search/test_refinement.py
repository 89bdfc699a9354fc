# SPDX-License-Identifier: MIT
from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from physim_drake.poses import Array, inverse, make_pose, transform_points
from physim_drake.registration.registration_model import registration_model
from physim_drake.search.refinement import JointRefiner, RefinementConfig
from physim_drake.search.states import StateRenderer
from tests.synthetic import (
    BOOK,
    TISSUES,
    SyntheticScene,
    library,
    look_at,
    perturbed,
    pose_error,
    renderer,
    resting,
    stack,
    synthesize,
    turned,
)

LOWER, UPPER = 0, 1


@cache
def made(noise: float = 0.0) -> SyntheticScene:
    return synthesize(stack(), noise=noise)


@cache
def refiner(noise: float = 0.0) -> JointRefiner:
    scene = made(noise).scene()
    models = [library()[k] for k in scene.object_ids]
    return JointRefiner(StateRenderer(scene, renderer(), 0.01), models)


def truth() -> dict[int, Array]:
    return dict(enumerate(made().X_SO))


def errors(placed: dict[int, Array]) -> Array:
    return np.array(
        [
            pose_error(
                placed[k],
                made().X_SO[k],
                library()[made().detections[k].object_id].symmetry,
            )
            for k in placed
        ]
    )


def gap(placed: dict[int, Array]) -> float:
    """Least signed distance (m) of the upper object's surface to the lower one."""
    lower, upper = (
        registration_model(library()[made().detections[k].object_id])
        for k in (LOWER, UPPER)
    )
    in_lower = inverse(placed[LOWER]) @ placed[UPPER]
    on_lower, _ = lower.distance_field.query(transform_points(in_lower, upper.points))
    on_upper, _ = upper.distance_field.query(
        transform_points(inverse(in_lower), lower.points)
    )
    return float(min(on_lower.min(), on_upper.min()))


def both_perturbed(seed: int, shift: float, degrees: float) -> dict[int, Array]:
    return {
        k: perturbed(X, shift, np.radians(degrees), 10 * seed + k)
        for k, X in truth().items()
    }


@pytest.mark.parametrize("seed", range(4))
def test_a_perturbed_stack_comes_back(seed: int) -> None:
    start = both_perturbed(seed, 0.003, 2.0)
    refined = refiner().refine(start)
    assert errors(start)[:, 0].min() > 2.9
    assert errors(refined)[:, 0].max() < 1.0
    assert errors(refined)[:, 1].max() < 0.5


@pytest.mark.parametrize("seed", range(2))
def test_noise_is_averaged_out(seed: int) -> None:
    refined = refiner(1.0).refine(both_perturbed(seed, 0.003, 2.0))
    assert errors(refined)[:, 0].max() < 2.0
    assert errors(refined)[:, 1].max() < 1.5


def test_the_truth_stays() -> None:
    refined = refiner().refine(truth())
    assert errors(refined)[:, 0].max() < 0.7
    assert errors(refined)[:, 1].max() < 0.4


def test_overlap_is_removed() -> None:
    start = truth()
    start[UPPER] = make_pose(p=[0, 0, -0.004]) @ start[UPPER]
    assert gap(start) < -0.003
    refined = refiner().refine(start)
    assert gap(refined) > -0.001
    assert errors(refined)[:, 0].max() < 1.0


def test_contact_is_kept() -> None:
    refined = refiner().refine(truth())
    assert abs(gap(refined)) < 8e-4
    lowest = transform_points(
        refined[LOWER], library()[made().detections[LOWER].object_id].mesh.vertices
    )[:, 2].min()
    assert abs(lowest) < 8e-4


def refined_gap(seen_higher: float, config: RefinementConfig) -> float:
    """The gap after refining the truth where the upper object is seen too high."""
    (lower, X_lower), (upper, X_upper) = stack()
    moved = make_pose(p=[0, 0, seen_higher]) @ X_upper
    scene = synthesize([(lower, X_lower), (upper, moved)], noise=0.0).scene()
    models = [library()[k] for k in scene.object_ids]
    drawing = StateRenderer(scene, renderer(), 0.01)
    return gap(JointRefiner(drawing, models, config).refine(truth()))


def test_overlap_that_the_image_shows_is_resisted() -> None:
    resisted = refined_gap(-0.004, RefinementConfig())
    believed = refined_gap(-0.004, RefinementConfig(overlap_weight=0.0))
    assert believed < -0.002
    assert resisted > 0.6 * believed


def test_a_gap_that_the_image_shows_is_resisted_where_there_was_contact() -> None:
    resisted = refined_gap(0.002, RefinementConfig())
    believed = refined_gap(0.002, RefinementConfig(contact_weight=0.0))
    assert believed > 0.001
    assert resisted < 0.8 * believed


def test_where_the_camera_saw_past_there_is_no_object() -> None:
    # A book, lying, one end of which a box above it hides: its points do not tell how
    # far it reaches under the box, but the end that is seen does.
    X_WC = look_at([0.0, -0.01, 0.6], [0.0, 0.0, 0.0])
    X_WO = resting(BOOK, turned("yz", 90, 10), 0.0, 0.0)
    above = resting(TISSUES, np.eye(3), 0.0, 0.1, 0.12)
    made = synthesize([(BOOK, X_WO), (TISSUES, above)], noise=0.0, X_WC=X_WC)
    slid = {0: make_pose(p=[0.0, -0.008, 0.0]) @ made.X_SO[0]}
    shifts = []
    for weight in (0.3, 0.0):
        config = RefinementConfig(silhouette_weight=weight)
        models = [library()[BOOK], library()[TISSUES]]
        drawing = StateRenderer(made.scene(), renderer(), 0.01)
        refined = JointRefiner(drawing, models, config).refine(slid)
        shifts.append(1e3 * np.linalg.norm((refined[0] - made.X_SO[0])[:3, 3]))
    assert shifts[0] < 2.0
    assert shifts[1] > 4.0


def test_objects_do_not_sink_into_the_table() -> None:
    start = {k: make_pose(p=[0, 0, -0.004]) @ X for k, X in truth().items()}
    refined = refiner().refine(start)
    assert errors(refined)[:, 0].max() < 1.0


def test_the_cost_falls_and_is_least_at_the_truth() -> None:
    start = both_perturbed(0, 0.004, 3.0)
    costs = [
        refiner().fine_cost(state)
        for state in (truth(), refiner().refine(start), start)
    ]
    assert costs[0] < 1.1 * costs[1] + 5
    assert costs[1] < 0.5 * costs[2]


def test_what_is_not_explained_costs() -> None:
    whole = refiner().fine_cost(truth())
    assert refiner().fine_cost({LOWER: truth()[LOWER]}) < 10 * whole + 1e4
    floating = truth()
    floating[UPPER] = make_pose(p=[0, 0, 0.05]) @ floating[UPPER]
    assert refiner().fine_cost(floating) > whole + 500


def test_a_single_object_is_refined_alone() -> None:
    start = {UPPER: both_perturbed(1, 0.003, 2.0)[UPPER]}
    refined = refiner().refine(start)
    assert set(refined) == {UPPER}
    assert errors(refined)[0, 0] < 1.5


def test_the_given_poses_are_not_written_to() -> None:
    start = both_perturbed(0, 0.003, 2.0)
    before = {k: X.copy() for k, X in start.items()}
    refiner().refine(start)
    for k, X in start.items():
        np.testing.assert_array_equal(X, before[k])
