# SPDX-License-Identifier: MIT
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from physim_drake.errors import InputError
from physim_drake.estimation.estimator import (
    EstimationConfig,
    Method,
    PoseEstimator,
    estimate_scene,
)
from physim_drake.estimation.workers import WorkerConfig
from physim_drake.hypotheses.generation import HypothesisConfig, PoseHypotheses
from physim_drake.hypotheses.super4pcs import Super4PcsConfig
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.observation import Detection
from physim_drake.poses import Array, inverse, make_pose, transform_points
from physim_drake.registration.registration_model import (
    lookalike_turns,
    registration_model,
)
from physim_drake.scene_estimate import SceneEstimate
from physim_drake.search.group_search import SearchConfig
from tests.synthetic import (
    BOOK,
    COFFEE,
    ERASER,
    GLUE,
    SOAP,
    X_WC,
    SyntheticScene,
    library,
    pair_apart,
    pose_error,
    resting,
    stack,
    synthesize,
    turned,
)

SEARCHES = (Method.PHYSIM_MCTS, Method.PHYSIM_HEURISTIC)


def quick(method: Method = Method.PHYSIM_MCTS, **settings: Any) -> EstimationConfig:
    steps = WorkerConfig(
        hypotheses=HypothesisConfig(
            super4pcs=Super4PcsConfig(hypotheses=4000), polished=400
        )
    )
    return replace(
        EstimationConfig(
            method=method, search=SearchConfig(expansions=40), steps=steps
        ),
        **settings,
    )


@cache
def stacked() -> SyntheticScene:
    return synthesize(stack(), noise=0.5)


@cache
def apart() -> SyntheticScene:
    return synthesize(pair_apart(), noise=0.5)


@cache
def small_library() -> ObjectLibrary:
    ids = (ERASER, SOAP, GLUE, BOOK, COFFEE)
    return ObjectLibrary([library()[k] for k in ids], "small")


def estimate(made: SyntheticScene, config: EstimationConfig) -> SceneEstimate:
    return estimate_scene(made.observation, small_library(), made.detections, config)


def errors(made: SyntheticScene, result: SceneEstimate) -> Array:
    """mm and degrees of each object, against the truth in the camera."""
    pairs = []
    for k, found in enumerate(result.objects):
        assert found.X_CO is not None
        X_CO = inverse(X_WC) @ made.X_WO[k]
        symmetry = library()[found.object_id].symmetry
        pairs.append(pose_error(found.X_CO, X_CO, symmetry))
    return np.array(pairs)


def poses(result: SceneEstimate) -> list[bytes]:
    return [o.X_CO.tobytes() if o.X_CO is not None else b"" for o in result.objects]


@cache
def stack_estimate(method: Method) -> SceneEstimate:
    return estimate(stacked(), quick(method))


def test_a_stack_is_found_by_searching() -> None:
    result = stack_estimate(Method.PHYSIM_MCTS)
    assert [o.object_id for o in result.objects] == [ERASER, SOAP]
    assert errors(stacked(), result)[:, 0].max() < 4
    assert errors(stacked(), result)[:, 1].max() < 3
    assert all(o.confidence > 0.8 for o in result.objects)


@pytest.mark.parametrize("method", list(Method))
def test_every_method_gives_a_stack_some_poses(method: Method) -> None:
    # The box of the eraser shows more of the soap than of itself, and few expansions
    # end the depth-first search early: only the tree search has to be right.
    result = stack_estimate(method)
    assert result.method == method
    assert all(o.found for o in result.objects)
    assert all(0 <= o.confidence <= 1 for o in result.objects)
    best = stack_estimate(Method.PHYSIM_MCTS)
    assert sum(o.confidence for o in result.objects) <= 0.02 + sum(
        o.confidence for o in best.objects
    )


def test_the_estimated_stack_is_physically_possible() -> None:
    lower, upper = (o.X_WO for o in stack_estimate(Method.PHYSIM_MCTS).objects)
    assert lower is not None
    assert upper is not None
    field = registration_model(library()[ERASER]).distance_field
    points = registration_model(library()[SOAP]).points
    gaps, _ = field.query(transform_points(inverse(lower) @ upper, points))
    assert gaps.min() == pytest.approx(0, abs=1.5e-3)
    height = transform_points(lower, library()[ERASER].mesh.vertices)[:, 2].min()
    assert height == pytest.approx(0, abs=1.5e-3)


@pytest.mark.parametrize("method", list(Method))
def test_objects_apart_are_found_by_every_method(method: Method) -> None:
    result = estimate(apart(), quick(method))
    axes = (60, 180)
    limit = {Method.PCA_ICP: axes, Method.FCN_PCA_ICP: axes}
    limit[Method.SUPER4PCS_ICP] = (12, 12)
    shift, turn = limit.get(method, (4, 4))
    found = errors(apart(), result)
    assert found[:, 0].max() < shift
    assert found[:, 1].max() <= turn
    assert all(o.found and o.reason == "" for o in result.objects)
    assert (len(result.trace) > 0) == (method in SEARCHES)


def test_objects_apart_are_searched_apart() -> None:
    result = estimate(apart(), quick())
    assert len(result.trace) >= 2
    assert all(np.shape(point[3])[0] == 1 for t in result.trace for point in t.points)


def test_the_result_does_not_depend_on_the_workers() -> None:
    two = estimate(stacked(), quick(workers=2))
    assert poses(two) == poses(stack_estimate(Method.PHYSIM_MCTS))
    assert [o.confidence for o in two.objects] == [
        o.confidence for o in stack_estimate(Method.PHYSIM_MCTS).objects
    ]


def test_the_result_does_not_depend_on_what_was_estimated_before() -> None:
    with PoseEstimator(small_library(), quick()) as estimator:
        estimator.estimate(apart().observation, apart().detections)
        again = estimator.estimate(stacked().observation, stacked().detections)
    assert poses(again) == poses(stack_estimate(Method.PHYSIM_MCTS))


def test_an_estimator_goes_on_after_an_error() -> None:
    config = quick(Method.PCA_ICP)
    unknown = Detection(99, apart().detections[0].box)
    with PoseEstimator(small_library(), config) as estimator:
        with pytest.raises(InputError, match="has no object with id 99"):
            estimator.estimate(apart().observation, [unknown])
        after = estimator.estimate(apart().observation, apart().detections)
    assert poses(after) == poses(estimate(apart(), config))


@pytest.mark.parametrize("method", [Method.PHYSIM_MCTS, Method.PCA_ICP])
def test_an_object_without_points_is_not_found_and_the_rest_is(method: Method) -> None:
    nothing = Detection(BOOK, np.array([2.0, 200.0, 22.0, 220.0]))
    first, second = apart().detections
    result = estimate_scene(
        apart().observation, small_library(), [first, nothing, second], quick(method)
    )
    missing = result.objects[1]
    assert not missing.found
    assert missing.X_WO is None
    assert missing.confidence == 0
    assert "segment has 0 points, at least 30" in missing.reason
    assert result.objects[0].found
    assert result.objects[2].found
    assert "not found (its segment" in str(result)


def test_a_wrong_object_has_little_confidence() -> None:
    first, second = apart().detections
    wrong = [replace(first, object_id=COFFEE), replace(second, object_id=BOOK)]
    result = estimate_scene(apart().observation, small_library(), wrong, quick())
    assert all(o.confidence < 0.6 for o in result.objects)


@pytest.mark.parametrize("place", [0, 1])
def test_an_object_that_is_not_there_costs_no_other_its_pose(place: int) -> None:
    made = apart()
    absent = replace(made.detections[place], object_id=BOOK)
    wrong = replace(made, detections=(*made.detections, absent))
    result = estimate(wrong, quick())
    assert not result.objects[2].found
    assert all(o.found and o.confidence > 0.9 for o in result.objects[:2])
    found = replace(result, objects=result.objects[:2])
    assert errors(made, found).max() < 2


def test_without_a_camera_pose_the_world_is_the_table() -> None:
    observation = replace(apart().observation, X_WC=None)
    result = estimate_scene(
        observation, small_library(), apart().detections, quick(Method.SUPER4PCS_ICP)
    )
    for found in result.objects:
        assert found.X_CO is not None
        assert found.X_WO is not None
        np.testing.assert_allclose(
            result.surface.X_CS @ found.X_WO, found.X_CO, atol=1e-9
        )
        assert 0 < found.X_WO[2, 3] < 0.1


def test_poses_are_given_in_the_world_of_the_camera_pose() -> None:
    result = stack_estimate(Method.PHYSIM_MCTS)
    for found in result.objects:
        assert found.X_CO is not None
        np.testing.assert_allclose(found.X_WO, X_WC @ found.X_CO, atol=1e-9)


def test_a_given_table_height_is_used() -> None:
    raised = make_pose(p=[0.0, 0.0, 0.7]) @ X_WC
    observation = replace(apart().observation, X_WC=raised)
    config = quick(Method.PCA_ICP)
    with PoseEstimator(small_library(), config) as estimator:
        result = estimator.estimate(observation, apart().detections, 0.7)
    assert result.surface.X_WS[2, 3] == pytest.approx(0.7)
    assert poses(result) == poses(
        estimate_scene(
            apart().observation, small_library(), apart().detections, config, 0.0
        )
    )


@pytest.mark.parametrize("method", [Method.PHYSIM_MCTS, Method.SUPER4PCS_ICP])
def test_hypotheses_made_before_are_used_in_place_of_new_ones(
    method: Method, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = apart()
    with PoseEstimator(small_library(), quick(method, rounds=1)) as estimator:
        fresh = estimator.estimate(made.observation, made.detections)
        prepared = estimator.prepare(made.observation, made.detections)
        hypotheses = estimator.hypotheses(prepared)
        for name in ("prepare_scene", "find_support_surface"):
            monkeypatch.delattr(f"physim_drake.estimation.preparation.{name}")
        monkeypatch.delattr("physim_drake.estimation.workers.generate_hypotheses")
        given = estimator.estimate_prepared(prepared, hypotheses)
    assert poses(given) == poses(fresh)
    assert [o.confidence for o in given.objects] == [
        o.confidence for o in fresh.objects
    ]


def with_hypotheses(
    made: SyntheticScene, X_WO: Sequence[Array], config: EstimationConfig
) -> SceneEstimate:
    """The estimate of a scene of one object with these hypotheses, best first."""
    with PoseEstimator(small_library(), config) as estimator:
        prepared = estimator.prepare(made.observation, made.detections, 0.0)
        X_SO = inverse(prepared.segmented.X_CS) @ inverse(X_WC) @ np.stack(X_WO)
        (detection,) = made.detections
        count = len(X_WO)
        given = PoseHypotheses(
            detection.object_id, X_SO, np.linspace(0.9, 0.8, count), np.arange(count)
        )
        return estimator.estimate_prepared(prepared, [given])


def test_an_object_whose_hypotheses_are_all_upside_down_is_turned_over() -> None:
    (turn,) = lookalike_turns(library()[COFFEE])
    lying = resting(COFFEE, turned("z", 30), 0.0, 0.0)
    made = synthesize(((COFFEE, lying),), noise=0.5)
    ((shift, angle),) = errors(
        made, with_hypotheses(made, [lying @ turn], quick(rounds=1))
    )
    assert shift < 2
    assert angle < 2


@pytest.mark.parametrize("first", [0, 1])
def test_an_object_that_fits_two_ways_claims_neither(first: int) -> None:
    """Only a corner of a box is measured: nobody can tell its length from its width."""
    width, length, height = library()[ERASER].mesh.extents
    along = make_pose(p=[-width / 2, length / 2, height / 2])
    across = make_pose(turned("z", 90), [-length / 2, width / 2, height / 2])
    made = synthesize(((ERASER, along),), noise=0.5)
    p_C = made.observation.intrinsics.unproject(made.observation.depth)
    x, y, _ = np.moveaxis(
        transform_points(X_WC, p_C.reshape(-1, 3)).reshape(p_C.shape), -1, 0
    )
    corner = (x > -0.03) & (y < 0.03)
    depth = np.where(corner, made.observation.depth, 0).astype(np.float32)
    made = replace(made, observation=replace(made.observation, depth=depth))
    ways = [along, across] if first == 0 else [across, along]
    ways = 8 * ways[:1] + ways[1:]  # the search stops before the other way
    result = with_hypotheses(made, ways, quick(rounds=1, search=SearchConfig(1)))
    assert result.objects[0].found
    assert 0.3 < result.objects[0].confidence < 0.7


def test_hypotheses_are_one_for_each_detection() -> None:
    made = apart()
    with PoseEstimator(small_library(), quick(Method.SUPER4PCS_ICP)) as estimator:
        prepared = estimator.prepare(made.observation, made.detections)
        hypotheses = estimator.hypotheses(prepared)
        with pytest.raises(ValueError, match="shorter"):
            estimator.estimate_prepared(prepared, hypotheses[:1])


@pytest.mark.parametrize("method", [Method.PHYSIM_MCTS, Method.PCA_ICP])
def test_nothing_to_find_is_no_error(method: Method) -> None:
    result = estimate_scene(apart().observation, small_library(), [], quick(method))
    assert result.objects == ()


def test_the_stages_are_timed() -> None:
    stages = stack_estimate(Method.PHYSIM_MCTS).stages
    assert {"segments", "hypotheses", "search", "refinement"} <= set(stages)
    assert all(seconds >= 0 for seconds in stages.values())


def test_what_a_detector_takes_for_each_other_is_exchanged() -> None:
    made = apart()
    first, second = made.detections
    X_CO = errors(made, estimate(made, quick()))
    taken_for_each_other = (
        replace(second, object_id=first.object_id, score=0.3, instead=(first,)),
        replace(first, object_id=second.object_id, score=0.9, instead=(second,)),
    )
    mended = estimate_scene(
        made.observation, small_library(), taken_for_each_other, quick()
    )
    np.testing.assert_array_equal(errors(made, mended), X_CO)
    assert mended.detections == (first, second)


def test_an_object_that_is_not_seen_must_be_confirmed_where_it_is_tried() -> None:
    made = apart()
    first, second = made.detections
    height, width = made.observation.depth.shape

    def found(object_id: int) -> list[bool]:
        """Whether an object is found where the second is, if only tried there."""
        place = replace(second, object_id=object_id, score=0.2)
        missed = replace(Detection.unseen(object_id, height, width), instead=(place,))
        result = estimate_scene(
            made.observation, small_library(), (first, missed), quick()
        )
        return [o.found for o in result.objects]

    assert found(second.object_id) == [True, True]
    assert found(BOOK) == [True, False]
