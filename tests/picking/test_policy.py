# SPDX-License-Identifier: MIT
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, pairwise

import numpy as np
import pytest

from physim_drake.objects.containers import ContainerName, load_container
from physim_drake.objects.model import ObjectLibrary
from physim_drake.picking.policy import (
    LookAgain,
    PickCandidate,
    PickConditions,
    PickOrder,
    PickPolicy,
    TopOfPileFirst,
    object_candidates,
)
from physim_drake.picking.suction_points import suction_points
from physim_drake.picking.surroundings import (
    PlacedObject,
    ToolShape,
    Wall,
    container_walls,
    placed_objects,
    tool_clearance,
)
from physim_drake.poses import inverse, make_pose, transform_points
from physim_drake.scene_estimate import SceneEstimate
from tests.picking.scenes import estimate_of, lifted
from tests.synthetic import (
    BALL,
    BOOK,
    COFFEE,
    ERASER,
    SOAP,
    TISSUES,
    Objects,
    library,
    resting,
    stack,
    turned,
)

TABLE = Wall(make_pose(p=[0.0, 0.0, -0.025]), np.array([2.0, 1.6, 0.05]))
ON_TABLE = PickConditions(walls=(TABLE,))


def order(
    objects: Objects,
    conditions: PickConditions = ON_TABLE,
    confidences: tuple[float, ...] = (),
) -> PickOrder:
    estimate = estimate_of(objects, confidences)
    return TopOfPileFirst().order(estimate, library(), conditions)


def apart() -> Objects:
    return (
        (SOAP, resting(SOAP, turned("y", 90), -0.15, 0.0)),
        (TISSUES, resting(TISSUES, np.eye(3), 0.15, 0.0)),
    )


def test_the_cup_meets_the_surface_against_its_normal() -> None:
    candidates = order(apart())
    assert {c.index for c in candidates} == {0, 1}
    for c in candidates:
        model = library()[c.object_id]
        p_O = transform_points(inverse(c.X_WO) @ c.X_WG, np.zeros((1, 3)))[0]
        np.testing.assert_allclose(p_O, c.p_O, atol=1e-12)
        points = suction_points(model)
        n = int(np.linalg.norm(points.positions - p_O, axis=1).argmin())
        assert points.quality[n] == c.quality
        normal = c.X_WO[:3, :3] @ points.normals[n]
        np.testing.assert_allclose(c.approach, -normal, atol=1e-12)
        assert np.cos(c.tilt) == pytest.approx(normal[2])
        assert np.linalg.det(c.X_WG[:3, :3]) == pytest.approx(1)


def test_turns_about_the_axis_leave_the_cup_where_it_is() -> None:
    candidate = order(apart())[0]
    poses = list(candidate.poses(6))
    assert len(poses) == 6
    np.testing.assert_allclose(poses[0], candidate.X_WG, atol=1e-12)
    for X, following in pairwise(poses):
        np.testing.assert_allclose(X[:3, 2:], candidate.X_WG[:3, 2:], atol=1e-12)
        assert X[:3, 0] @ following[:3, 0] == pytest.approx(np.cos(np.pi / 3))


def test_what_lies_on_top_comes_first() -> None:
    assert [c.index for c in order(stack())][:1] == [1]
    # Also where the top is less sure than the bottom, and the other way round listed.
    assert order(stack(), confidences=(1.0, 0.55))[0].index == 1
    assert order(stack()[::-1])[0].index == 0


def test_a_lower_object_comes_later_and_says_what_lies_on_it() -> None:
    book = resting(BOOK, turned("y", 90), 0.0, 0.0)
    height = float(library()[BOOK].extents[0])
    soap = resting(SOAP, turned("y", 90), 0.0, 0.06, height)
    candidates = order(((BOOK, book), (SOAP, soap)))
    lower = [c for c in candidates if c.index == 0]
    assert lower
    assert [c.index for c in candidates] == sorted(
        (c.index for c in candidates), reverse=True
    )
    assert lower[0].reasons[0] == "below dove_beauty_bar"


def test_the_surer_of_two_equal_objects_comes_first() -> None:
    twins = (
        (SOAP, resting(SOAP, turned("y", 90), -0.15, 0.0)),
        (SOAP, resting(SOAP, turned("y", 90), 0.15, 0.0)),
    )
    assert order(twins, confidences=(0.6, 0.9))[0].index == 1
    assert order(twins, confidences=(0.9, 0.6))[0].index == 0


def test_doubtful_and_missing_objects_are_to_be_looked_at_again() -> None:
    estimate = estimate_of(apart(), (0.9, 0.3))
    lost = replace(
        estimate.objects[0], X_WO=None, X_CO=None, confidence=0.0, reason="no points"
    )
    estimate = replace(estimate, objects=(*estimate.objects, lost))
    result = TopOfPileFirst().order(estimate, library(), ON_TABLE)
    assert {c.index for c in result} == {0}
    assert result.look_again == (
        LookAgain(1, "kleenex_tissue_box", "confidence 0.30 is below 0.50"),
        LookAgain(2, "dove_beauty_bar", "not found: no points"),
    )
    skipping = replace(ON_TABLE, skip=frozenset({0, 2}))
    result = TopOfPileFirst().order(estimate, library(), skipping)
    assert len(result) == 0
    assert [item.index for item in result.look_again] == [1]


def test_an_object_too_near_leaves_no_room_for_the_tool() -> None:
    low = (SOAP, resting(SOAP, turned("y", 90), 0.0, 0.0))
    reach = float(library()[SOAP].extents[1]) / 2
    box = resting(TISSUES, np.eye(3), 0.0, 0.0)
    beside = make_pose(p=[0.0, reach + float(library()[TISSUES].extents[1]) / 2, 0.0])

    def soap_alone(objects: Objects) -> tuple[PickCandidate, ...]:
        placed = placed_objects(estimate_of(objects), library())
        return object_candidates(placed[0], placed, ON_TABLE)

    alone, hindered = soap_alone((low,)), soap_alone((low, (TISSUES, beside @ box)))
    p_alone, p_hindered = (
        np.array([c.X_WG[:2, 3] for c in found]) for found in (alone, hindered)
    )
    room = reach - p_hindered[:, 1]
    # The block behind the tube passes over the box; the cup keeps its distance.
    assert room.min() >= 0.015 + ON_TABLE.clearance - 1e-3
    assert p_hindered[:, 1].max() <= p_alone[:, 1].max()
    over = make_pose(p=[0.0, 0.0, 0.15]) @ box
    assert soap_alone((low, (TISSUES, over))) == ()


def test_walls_of_a_tote_keep_the_tool_away() -> None:
    tote = load_container(ContainerName.TOTE)
    X_WK = make_pose(turned("z", 90), [0.5, 0.3, 0.8])
    walls = container_walls(tote, X_WK)
    assert len(walls) == len(tote.boxes)
    ball = resting(BALL, np.eye(3), 0.0, 0.0)
    radius = 0.035
    in_corner = X_WK @ make_pose(p=[-0.28 + radius, -0.21 + radius, 0.0]) @ ball
    in_middle = X_WK @ ball
    conditions = PickConditions(walls=walls)
    result = {}
    for name, X in (("corner", in_corner), ("middle", in_middle)):
        placed = placed_objects(estimate_of(((BALL, X),)), library())
        result[name] = object_candidates(placed[0], placed, conditions)
    assert max(c.tilt for c in result["middle"]) > np.radians(30)
    assert len(result["corner"]) < len(result["middle"])
    for c in result["corner"]:
        tool = transform_points(c.X_WG, conditions.tool.points())
        assert min(wall.distances(tool).min() for wall in walls) > 0.003


def test_distances_to_a_wall_are_signed() -> None:
    wall = Wall(make_pose(turned("z", 90), [1.0, 0.0, 0.0]), np.array([0.4, 0.2, 0.6]))
    points = np.array([[1.0, 0.0, 0.0], [1.2, 0.0, 0.0], [1.4, 0.2, 0.7], [1, 0.19, 0]])
    expected = [-0.1, 0.1, np.hypot(0.3, 0.4), -0.01]
    np.testing.assert_allclose(wall.distances(points), expected, atol=1e-12)


def test_the_tool_reaches_behind_the_lip() -> None:
    tool = ToolShape()
    points = tool.points()
    assert points[:, 2].max() < 0
    radii = np.linalg.norm(points[:, :2], axis=1)
    for start, end, radius in tool.sections:
        inside = (-points[:, 2] > start + 1e-6) & (-points[:, 2] < end - 1e-6)
        np.testing.assert_allclose(radii[inside], radius)
    # 5 cm beside the tube, a box: the clearance is what is left.
    box = PlacedObject(0, library()[TISSUES], np.eye(4), 1.0)
    half = library()[TISSUES].extents / 2
    middle = library()[TISSUES].mesh.bounds.mean(axis=0)
    beside = middle + np.array([half[0] + 0.065, 0.0, 0.0])
    X_WG = make_pose(np.diag([1.0, -1.0, -1.0]), beside)
    slim = ToolShape(((0.0, 0.05, 0.015),))
    clearance = tool_clearance(X_WG[None], slim, [box])
    assert clearance[0] == pytest.approx(0.05, abs=1e-3)


def test_steep_sides_are_left_alone() -> None:
    can = ((COFFEE, resting(COFFEE, turned("x", 90), 0.0, 0.0)),)
    for limit in (20.0, 60.0):
        steep = np.radians(limit)
        tilts = [c.tilt for c in order(can, replace(ON_TABLE, max_tilt=steep))]
        assert tilts
        assert max(tilts) <= steep


def test_candidates_of_one_object_are_few_and_apart() -> None:
    candidates = order(((TISSUES, resting(TISSUES, np.eye(3), 0.0, 0.0)),))
    assert 2 <= len(candidates) <= ON_TABLE.per_object
    p = np.array([c.X_WG[:3, 3] for c in candidates])
    gaps = np.linalg.norm(p[:, None] - p, axis=2)[~np.eye(len(p), dtype=bool)]
    assert gaps.min() >= ON_TABLE.spacing


def test_an_object_in_the_air_is_reached_from_above_all_the_same() -> None:
    high = ((ERASER, lifted(resting(ERASER, np.eye(3), 0.0, 0.0), 0.3)),)
    assert len(order(high)) > 0
    upside_down = ((ERASER, resting(ERASER, turned("x", 180), 0.0, 0.0)),)
    assert len(order(upside_down)) > 0


class SurestFirst:
    """A policy as a user writes one."""

    def order(
        self,
        estimate: SceneEstimate,
        library: ObjectLibrary,
        conditions: PickConditions = ON_TABLE,
    ) -> Sequence[PickCandidate]:
        placed = placed_objects(estimate, library)
        found = (object_candidates(o, placed, conditions) for o in placed)
        return sorted(chain(*found), key=lambda c: -c.confidence)


def test_a_policy_of_ones_own_is_a_dozen_lines() -> None:
    policy: PickPolicy = SurestFirst()
    estimate = estimate_of(stack(), (0.95, 0.6))
    found = policy.order(estimate, library())
    assert found[0].confidence == max(c.confidence for c in found)
    joined = PickOrder.of(found)
    assert list(joined) == list(found)
    assert joined[:2] == tuple(found[:2])
    assert joined.look_again == ()
    assert PickOrder.of(joined) is joined


def test_a_candidate_prints_as_one_line() -> None:
    text = str(order(stack())[0])
    assert text.startswith("dove_beauty_bar: quality 0.9")
    assert "\n" not in text
