# SPDX-License-Identifier: MIT
"""What an estimate claims where the image leaves doubt."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from functools import cache

import pytest
import trimesh

from physim_drake.batch.images import ImageResult
from physim_drake.errors import InputError
from physim_drake.estimation.config import LEAST_CONFIDENCE
from physim_drake.estimation.estimator import (
    EstimationConfig,
    Method,
    PoseEstimator,
    estimate_scene,
)
from physim_drake.objects.model import ObjectLibrary, ObjectModel
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.poses import SymmetryGroup, inverse, make_pose
from physim_drake.rendering.depth import DepthRenderer
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from physim_drake.search.states import composite
from tests.estimation.test_estimator import apart, poses, quick, small_library
from tests.synthetic import (
    BOOK,
    CAMERA,
    SOAP,
    X_WC,
    mask_box,
    noisy,
    plane_depth,
    turned,
)


@cache
def carton() -> ObjectModel:
    """A box; its shape tells neither its ends nor its sides apart."""
    return ObjectModel.from_mesh(1, "carton", trimesh.creation.box([0.10, 0.06, 0.04]))


@cache
def seen_carton() -> tuple[RgbdObservation, Detection]:
    """It lies on the table, and a box is around it."""
    X_WO = make_pose(turned("z", 30), [0.0, 0.0, 0.02])
    image = DepthRenderer({1: carton()}, CAMERA).render(1, inverse(X_WC) @ X_WO)
    table = plane_depth(CAMERA, X_WC, [0.0, 0.0, 1.0], 0.0)
    depth = noisy(composite(table, image), 0.5, 0)
    return RgbdObservation(depth, CAMERA, None, X_WC), Detection(1, mask_box(image > 0))


def carton_estimate(
    symmetry: SymmetryGroup, config: EstimationConfig
) -> ObjectEstimate:
    library = ObjectLibrary([replace(carton(), symmetry=symmetry)], "carton")
    observation, detection = seen_carton()
    (found,) = estimate_scene(observation, library, [detection], config).objects
    return found


def test_a_confidence_is_shared_with_turns_that_the_shape_does_not_tell_apart() -> None:
    plain = carton_estimate(carton().symmetry, quick())
    assert plain.confidence > 0.9
    printed = carton_estimate(SymmetryGroup(), quick())  # print tells its ends apart
    assert 0.2 < printed.confidence < 0.6 * plain.confidence
    assert printed.found  # it is there, whichever way it lies
    again = carton_estimate(SymmetryGroup(), quick(workers=2))
    assert again.confidence == printed.confidence


def test_what_the_image_does_not_confirm_is_not_found() -> None:
    first, second = apart().detections
    wrong = [replace(first, object_id=BOOK), second]
    with PoseEstimator(small_library(), quick(rounds=1)) as estimator:
        prepared = estimator.prepare(apart().observation, wrong)
        hypotheses = estimator.hypotheses(prepared)

    def with_least(least: float | None) -> SceneEstimate:
        config = replace(quick(rounds=1), least_confidence=least)
        with PoseEstimator(small_library(), config) as estimator:
            return estimator.estimate_prepared(prepared, hypotheses)

    everything = with_least(0.0)
    book, soap = everything.objects
    assert 0.1 < book.confidence < LEAST_CONFIDENCE < soap.confidence
    above = with_least(None)
    missing, kept = above.objects
    assert missing.X_CO is missing.X_WO is None
    assert missing.confidence == 0.0
    told = re.fullmatch(r"confidence (\d\.\d\d) is below 0\.50", missing.reason)
    assert told
    # What it shares with other poses of it counts here.
    assert book.confidence - 0.01 < float(told[1]) < LEAST_CONFIDENCE
    assert f"not found ({missing.reason})" in str(above)
    assert poses(above)[1:] == poses(everything)[1:]
    assert kept.confidence == soap.confidence
    assert poses(with_least(None)) == poses(above)
    exact = with_least(book.confidence)
    assert poses(exact) == poses(everything)
    result = ImageResult((1, 0), apart().observation, above, 1.0)
    assert [row.object_id for row in result.rows()] == [SOAP]


def test_how_much_confidence_is_required() -> None:
    assert EstimationConfig().required_confidence == LEAST_CONFIDENCE
    assert EstimationConfig(Method.PHYSIM_HEURISTIC).required_confidence > 0
    for method in (Method.SUPER4PCS_ICP, Method.PCA_ICP, Method.FCN_PCA_ICP):
        assert EstimationConfig(method).required_confidence == 0
        given = EstimationConfig(method, least_confidence=0.3)
        assert given.required_confidence == 0.3
    assert EstimationConfig.paper().required_confidence == 0
    assert EstimationConfig(least_confidence=0.0).required_confidence == 0


@pytest.mark.parametrize("least", [-0.1, 1.1, math.nan, math.inf])
def test_a_required_confidence_is_a_share(least: float) -> None:
    with pytest.raises(InputError, match=r"least_confidence: is .*from 0 to 1"):
        EstimationConfig(least_confidence=least)
