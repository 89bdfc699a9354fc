# SPDX-License-Identifier: MIT
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from physim_drake.observation.observation import Detection, Segment
from physim_drake.poses import make_pose
from physim_drake.search.dependency import dependency_graph

# Straight above the table, 1 m high: far from the camera is low.
FROM_ABOVE = make_pose(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 1.0])
# From the side: the camera's z is the table's y.
FROM_SIDE = make_pose([[1, 0, 0], [0, 0, -1], [0, 1, 0]], [0.0, 0.0, 1.0])
CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
NOWHERE = (0.0, 0.0, 0.0, 0.0)


def segment(
    centre: Sequence[float],
    half: float = 0.05,
    box: Sequence[float] = NOWHERE,
) -> Segment:
    points = np.array(centre) + half * CUBE
    return Segment(
        Detection(1, np.array(box, dtype=float)),
        points,
        np.zeros_like(points),
        np.zeros((1, 1), dtype=bool),
    )


def empty() -> Segment:
    none = np.zeros((0, 3))
    box = np.array([0.0, 0.0, 100.0, 100.0])
    return Segment(Detection(1, box), none, none, np.zeros((1, 1), dtype=bool))


def test_what_supports_goes_first() -> None:
    graph = dependency_graph([segment([0, 0, 0.2]), segment([0.02, 0, 0.1])], FROM_SIDE)
    assert graph.edges == ((1, 0),)
    assert graph.components == ((1, 0),)


def test_a_tower_is_placed_from_below() -> None:
    tower = [segment([0, 0, h]) for h in (0.3, 0.1, 0.2)]
    graph = dependency_graph(tower, FROM_SIDE)
    assert graph.components == ((1, 2, 0),)
    assert set(graph.edges) == {(1, 0), (1, 2), (2, 0)}


def test_what_hides_goes_first() -> None:
    far = segment([0.0, 0.5, 0.1], box=[0, 0, 50, 50])
    near = segment([0.0, 0.0, 0.1], box=[40, 40, 90, 90])
    graph = dependency_graph([far, near], FROM_SIDE)
    assert graph.edges == ((1, 0),)


def test_objects_apart_are_independent() -> None:
    graph = dependency_graph(
        [
            segment([0, 0, 0.1], box=[0, 0, 20, 20]),
            segment([0.5, 0, 0.1], box=[20, 0, 40, 20]),
            segment([0.52, 0, 0.2], box=[60, 0, 80, 20]),
        ],
        FROM_SIDE,
    )
    assert graph.components == ((0,), (1, 2))


def test_footprints_that_only_touch_by_their_boxes_are_apart() -> None:
    # Two thin diagonal objects whose bounding boxes overlap, side by side.
    line = np.linspace(-0.1, 0.1, 20)
    points = np.stack([line, line, np.zeros(20)], axis=1)
    points = np.concatenate([points, points + np.array([0.01, -0.01, 0.05])])
    shifted = points + np.array([0.06, -0.06, 0.1])
    none = np.zeros((1, 1), dtype=bool)
    segments = [
        Segment(Detection(1, np.zeros(4)), p, np.zeros_like(p), none)
        for p in (points, shifted)
    ]
    assert dependency_graph(segments, FROM_SIDE).edges == ()


def test_support_wins_over_hiding() -> None:
    # Seen from above, what lies on top is nearer and hides what carries it.
    below = segment([0, 0, 0.1], box=[0, 0, 50, 50])
    above = segment([0, 0, 0.2], box=[10, 10, 40, 40])
    graph = dependency_graph([above, below], FROM_ABOVE)
    assert graph.edges == ((1, 0),)


def test_a_cycle_over_three_is_cut_where_depth_differs_least() -> None:
    # 0 carries 1; 1 hides 2, 40 cm behind it; 2 would hide 0, 5 cm behind it.
    carrier = segment([0.0, 0.95, 0.1], half=0.2, box=[0, 60, 50, 90])
    top = segment([0.0, 0.5, 0.5], half=0.3, box=[0, 0, 50, 40])
    other = segment([0.9, 0.9, 0.1], half=0.05, box=[0, 30, 50, 70])
    graph = dependency_graph([carrier, top, other], FROM_SIDE)
    assert graph.edges == ((0, 1), (1, 2))
    assert graph.components == ((0, 1, 2),)


def test_a_detection_without_points_depends_on_nothing() -> None:
    graph = dependency_graph(
        [empty(), segment([0, 0, 0.1], box=[0, 0, 50, 50])], FROM_SIDE
    )
    assert graph.edges == ()
    assert graph.components == ((0,), (1,))


def test_few_points_have_a_footprint_too() -> None:
    points = np.array([[0.0, 0.0, 0.3], [0.01, 0.0, 0.3]])
    thin = Segment(
        Detection(1, np.zeros(4)), points, 0 * points, np.zeros((1, 1), dtype=bool)
    )
    graph = dependency_graph([thin, segment([0, 0, 0.1])], FROM_SIDE)
    assert graph.edges == ((1, 0),)


def test_nothing_detected() -> None:
    assert dependency_graph([], FROM_SIDE).components == ()


@given(st.integers(0, 2**31), st.integers(1, 9))
def test_every_object_is_in_one_group_and_after_what_it_depends_on(
    seed: int, count: int
) -> None:
    generator = np.random.default_rng(seed)

    def random_segment() -> Segment:
        corner = generator.uniform(0, 80, 2)
        box = [*corner, *(corner + generator.uniform(5, 60, 2))]
        return segment(generator.uniform(-0.2, 0.2, 3), 0.05, box)

    graph = dependency_graph([random_segment() for _ in range(count)], FROM_SIDE)
    placed = [k for component in graph.components for k in component]
    assert sorted(placed) == list(range(count))
    for first, second in graph.edges:
        (component,) = (c for c in graph.components if first in c)
        assert component.index(first) < component.index(second)
