# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physim_drake.batch.detection_source import DetectionSource
from physim_drake.datasets.bop import BopDataset
from physim_drake.errors import InputError
from physim_drake.estimation.estimator import EstimationConfig, Method, PoseEstimator
from physim_drake.pose_errors import PoseError
from physim_drake.rendering.depth import DepthRenderer
from physim_drake.reporting.explanation import (
    Explanation,
    error_size,
    explain_image,
)
from tests.reporting.explained import BOTTLE, BOX, CRAYONS, EXAMPLE, bare, example


def renderer(explanation: Explanation) -> DepthRenderer:
    return DepthRenderer(explanation.library, explanation.observation.intrinsics)


def test_the_estimate_is_the_one_that_is_made_without_explaining() -> None:
    e = example()
    with PoseEstimator(e.library, e.config) as estimator:
        plain = estimator.estimate(e.observation, e.detections)
    for mine, other in zip(e.estimate.objects, plain.objects, strict=True):
        np.testing.assert_array_equal(mine.X_CO, other.X_CO)


@pytest.mark.parametrize("explanation", [example, bare])
def test_the_recorded_searches_are_those_of_the_estimate(explanation) -> None:  # type: ignore[no-untyped-def]
    e = explanation()
    first = {}
    for trace in e.estimate.trace:
        first.setdefault(frozenset(trace.indices), trace)
    assert {frozenset(r.order) for r in e.searches} == set(first)
    for record in e.searches:
        trace = first[frozenset(record.order)]
        assert record.result.expansions == trace.expansions
        points = [(p.expansion, p.score) for p in record.result.trace]
        assert points == [(n, score) for n, _, score, _ in trace.points]
        best = max(s.score for s in record.selections)
        assert best == points[-1][1]
        assert record.tree().visits == len(record.selections)


def test_what_a_detector_takes_for_each_other_is_explained_as_exchanged() -> None:
    e, dataset = example(), BopDataset(EXAMPLE)
    masks = {d.object_id: d for d in dataset.masks(1, 0)}
    box, crayons, bottle = (masks[d.object_id] for d in e.detections)
    wrong = [
        replace(bottle, object_id=box.object_id, score=0.3, instead=(box,)),
        crayons,
        replace(box, object_id=bottle.object_id, score=0.9, instead=(bottle,)),
    ]
    mended = explain_image(
        dataset, (1, 0), lambda _: wrong, "mixed up", e.library, e.config
    )
    assert mended.detections[BOX] is box
    assert mended.detections[BOTTLE] is bottle
    for k, item in enumerate(mended.estimate.objects):
        error = mended.error(k, item.X_CO)
        assert error is not None
        assert error_size(error) < 1


def test_confidence_is_the_product_of_the_shares() -> None:
    for e in (example(), bare()):
        confirmed = e.confirmations(renderer(e))
        for item, part in zip(e.estimate.objects, confirmed, strict=True):
            if item.found:
                product = part.agrees * part.explained
                assert item.confidence == pytest.approx(product, abs=1e-3)


def test_errors_shrink_from_hypothesis_to_estimate() -> None:
    e = example()
    for k, item in enumerate(e.estimate.objects):
        nearest = e.nearest_representative(k)
        assert nearest is not None
        poses = e.scene.X_CS @ e.hypotheses[k].poses
        sizes = [error_size(error) for X in poses if (error := e.error(k, X))]
        assert sizes[nearest] == min(sizes)
        final = e.error(k, item.X_CO)
        assert final is not None
        assert error_size(final) < max(sizes)
        assert final.geodesic_deg < 3.0
        assert final.translation_mm < 5.0


def test_searched_pose_is_that_of_the_best_state() -> None:
    e = example()
    (record,) = e.searches
    best = record.result.states[0]
    assert best.score == max(s.score for s in record.selections)
    for n, k in enumerate(record.order):
        np.testing.assert_allclose(e.searched_pose(k), e.scene.X_CS @ best.poses[n])


def test_what_is_not_known_is_none() -> None:
    e = bare()
    assert e.truth == (None, None, None)
    assert e.error(BOTTLE, e.estimate.objects[BOTTLE].X_CO) is None
    assert e.nearest_representative(BOTTLE) is None
    assert e.searched_pose(CRAYONS) is None
    assert not e.estimate.objects[CRAYONS].found
    assert all(CRAYONS not in record.order for record in e.searches)


def test_seconds_are_those_of_the_stages() -> None:
    seconds = example().seconds
    assert set(seconds) == {"hypotheses", "search", "refinement"}
    assert all(s > 0 for s in seconds.values())


def test_objects_of_a_kind_are_numbered() -> None:
    e = example()
    twice = replace(e, detections=(*e.detections, e.detections[BOTTLE]))
    assert twice.names[BOTTLE] == "up_glucose_bottle (1)"
    assert twice.names[-1] == "up_glucose_bottle (2)"
    assert twice.names[CRAYONS] == e.names[CRAYONS] == "crayola_24_ct"


def test_both_parts_of_an_error_add_up() -> None:
    error = PoseError(0.0, np.radians(5.0), 0.01, np.zeros((1, 2)))
    assert error_size(error) == pytest.approx(2.0)


def test_only_the_tree_search_is_explained() -> None:
    dataset = BopDataset(EXAMPLE)
    source = DetectionSource.default(dataset)
    config = EstimationConfig(Method.PCA_ICP)
    with pytest.raises(InputError, match="explain physim-mcts"):
        explain_image(
            dataset,
            (1, 0),
            source.look_up,
            source.name,
            example().library,
            config,
        )
