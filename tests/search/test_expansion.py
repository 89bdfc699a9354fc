# SPDX-License-Identifier: MIT
from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from physim_drake.poses import Array, inverse, make_pose, transform_points
from physim_drake.registration.registration_model import registration_model
from physim_drake.search.expansion import Rollout, SceneExpander
from tests.synthetic import (
    ERASER,
    SOAP,
    SyntheticScene,
    library,
    mask_box,
    pair_apart,
    perturbed,
    pose_error,
    renderer,
    stack,
    synthesize,
)

LOWER, UPPER = 0, 1


@cache
def made() -> SyntheticScene:
    return synthesize(stack(), noise=0.5)


@cache
def expander() -> SceneExpander:
    return SceneExpander(made().scene(), library(), renderer())


def distances(k: int, X_SO: Array, points: Array) -> Array:
    field = registration_model(expander().models[k]).distance_field
    return np.abs(field.query(transform_points(inverse(X_SO), points))[0])


def error(k: int, X: Array) -> tuple[float, float]:
    return pose_error(X, made().X_SO[k], expander().models[k].symmetry)


def overlap(k: int, X: Array, j: int, Y: Array) -> float:
    field = registration_model(expander().models[j]).distance_field
    points = registration_model(expander().models[k]).points
    d, _ = field.query(transform_points(inverse(Y) @ X, points))
    return float(max(0.0, -d.min()))


def test_points_that_a_placed_object_explains_are_taken_away() -> None:
    whole, _ = expander().resegment({}, LOWER)
    upper = {UPPER: made().X_SO[UPPER]}
    left, normals = expander().resegment(upper, LOWER)
    assert len(left) == len(normals) < len(whole)
    assert distances(UPPER, made().X_SO[UPPER], left).min() > 0.008
    # The box of the eraser holds the soap too: those points are what went.
    gone = len(whole) - len(left)
    assert gone > 0.15 * len(whole)
    assert np.percentile(distances(LOWER, made().X_SO[LOWER], left), 95) < 0.006


def test_an_object_elsewhere_takes_nothing() -> None:
    away = {UPPER: make_pose(p=[1.0, 0, 0]) @ made().X_SO[UPPER]}
    whole, _ = expander().resegment({}, LOWER)
    left, _ = expander().resegment(away, LOWER)
    np.testing.assert_array_equal(left, whole)


def test_a_segment_that_would_vanish_stays_whole() -> None:
    whole, _ = expander().resegment({}, UPPER)
    covered, _ = expander().resegment({LOWER: made().X_SO[UPPER]}, UPPER)
    assert len(covered) <= len(whole)
    everything = SceneExpander(
        synthesize([stack()[1], stack()[1]], noise=0.0).scene(), library(), renderer()
    )
    own = {0: everything.scene.X_CS}
    assert len(everything.resegment({}, 1)[0]) == len(everything.resegment(own, 1)[0])


@pytest.mark.parametrize("seed", range(3))
def test_a_hypothesis_comes_to_rest_where_the_object_is(seed: int) -> None:
    start = perturbed(made().X_SO[LOWER], 0.008, np.radians(6), seed)
    X = expander().expand({UPPER: made().X_SO[UPPER]}, LOWER, start)
    shift, turn = error(LOWER, X)
    assert shift < 3
    assert turn < 2.5


@pytest.mark.parametrize("seed", range(3))
def test_an_object_rests_on_the_one_below(seed: int) -> None:
    start = perturbed(made().X_SO[UPPER], 0.008, np.radians(6), seed)
    below = {LOWER: made().X_SO[LOWER]}
    X = expander().expand(below, UPPER, start)
    shift, turn = error(UPPER, X)
    assert shift < 3
    assert turn < 2.5
    assert overlap(UPPER, X, LOWER, below[LOWER]) < 5e-4
    assert X[2, 3] == pytest.approx(made().X_SO[UPPER][2, 3], abs=1e-3)


def test_what_is_not_placed_yet_may_hold_an_object_up() -> None:
    # Alone the soap would fall to the table, where the image does not show it.
    X = expander().expand({}, UPPER, made().X_SO[UPPER])
    assert error(UPPER, X)[0] < 5


def test_an_object_is_not_left_inside_another() -> None:
    inside = made().X_SO[UPPER] @ make_pose(p=[0, 0, 0])
    inside[2, 3] -= 0.012
    below = {LOWER: made().X_SO[LOWER]}
    X = expander().expand(below, UPPER, inside)
    assert overlap(UPPER, X, LOWER, below[LOWER]) < 1e-3


def test_physics_puts_down_what_seems_to_float() -> None:
    # The camera sees both objects 4 mm too high, as a badly calibrated one does.
    up = make_pose(p=[0.0, 0.0, 0.004])
    apart = synthesize([(i, up @ X) for i, X in pair_apart()], noise=0.5)
    expander = SceneExpander(apart.scene(), library(), renderer())
    for k, X_seen in enumerate(apart.X_SO):
        X = expander.expand({}, k, X_seen)
        lowest = transform_points(X, expander.models[k].mesh.vertices)[:, 2].min()
        assert lowest == pytest.approx(0, abs=1e-3)


def test_a_rollout_places_all_and_scores_the_end() -> None:
    apart = synthesize(pair_apart(), noise=0.5)
    expander = SceneExpander(apart.scene(), library(), renderer())
    result = expander.run(Rollout((), tuple(enumerate(apart.X_SO))))
    assert len(result.poses) == 2
    state = dict(enumerate(result.poses))
    assert result.score == expander.renderer.score(expander.renderer.image(state))
    foreground = np.count_nonzero(expander.scene.observed)
    assert result.score > 0.9 * foreground


def test_a_rollout_goes_on_from_its_state() -> None:
    whole = expander().run(
        Rollout((), tuple((k, made().X_SO[k]) for k in (LOWER, UPPER)))
    )
    rest = expander().run(
        Rollout(((LOWER, whole.poses[0]),), ((UPPER, made().X_SO[UPPER]),))
    )
    np.testing.assert_array_equal(rest.poses[0], whole.poses[1])
    assert rest.score == whole.score


def test_the_truth_scores_higher_than_a_flip() -> None:
    def score(X: Array) -> int:
        return (
            expander().run(Rollout(((LOWER, made().X_SO[LOWER]),), ((UPPER, X),))).score
        )

    # On its edge, and crosswise.
    on_edge = made().X_SO[UPPER] @ make_pose([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    assert score(made().X_SO[UPPER]) > score(on_edge)


def test_the_boxes_of_the_stack_overlap() -> None:
    lower, upper = (mask_box(mask) for mask in made().masks)
    assert lower[0] < upper[2]
    assert upper[0] < lower[2]
    assert [d.object_id for d in made().detections] == [ERASER, SOAP]


def test_the_truth_is_nearly_at_rest() -> None:
    assert expander().unrest(dict(enumerate(made().X_SO))) < 0.003


def test_a_state_whose_top_lacks_support_is_far_from_rest() -> None:
    true = dict(enumerate(made().X_SO))
    aside = make_pose(p=[0.08, 0.0, 0.0]) @ true[LOWER]
    assert expander().unrest(true | {LOWER: aside}) > 0.01
