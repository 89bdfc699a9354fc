# SPDX-License-Identifier: MIT
from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physim_drake.camera import CameraIntrinsics, DepthImage
from physim_drake.observation.observation import Detection, Segment
from physim_drake.observation.segmented_scene import SegmentedScene
from physim_drake.poses import Array, make_pose
from physim_drake.rendering.windows import DepthWindow, crop
from physim_drake.search.states import Confirmation, StateRenderer, composite

CAMERA = CameraIntrinsics(4, 2, 10.0, 10.0, 1.5, 0.5)
X_CS = make_pose(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 1.0])


def image(*rows: list[float]) -> DepthImage:
    return np.array(rows, dtype=np.float32)


class FakeRenderer:
    """Hands out an image an object, whatever its pose, and counts."""

    def __init__(self, images: dict[int, DepthImage]) -> None:
        self.images = images
        self.calls: list[tuple[int, Array]] = []

    def window(self, object_id: int, X_CO: Array) -> DepthWindow:
        self.calls.append((object_id, X_CO))
        return crop(self.images[object_id])


DEPTH = image([0.5, 0.5, 0.9, 0.0], [0.6, 0.6, 0.9, 0.9])
OBSERVED = image([0.5, 0.5, 0.0, 0.0], [0.6, 0.6, 0.0, 0.0])
NEAR = image([0.5, 0.52, 0.5, 0.5], [0.0, 0.0, 0.0, 0.0])
FAR = image([0.7, 0.0, 0.0, 0.0], [0.605, 0.595, 0.6, 0.0])


def make_scene() -> SegmentedScene:
    none = np.zeros((0, 3))
    top = np.zeros((2, 4), dtype=bool)
    top[0, :2] = True
    bottom = np.zeros((2, 4), dtype=bool)
    bottom[1, :2] = True
    box = np.zeros(4)
    segments = [
        Segment(Detection(7, box), none, none, top),
        Segment(Detection(9, box), none, none, bottom),
    ]
    return SegmentedScene(segments, DEPTH, OBSERVED, CAMERA, X_CS)


def make_renderer(**kwargs: Any) -> tuple[StateRenderer, FakeRenderer]:
    fake = FakeRenderer({7: NEAR, 9: FAR})
    return StateRenderer(make_scene(), cast(Any, fake), 0.01, **kwargs), fake


BOTH = {0: np.eye(4), 1: np.eye(4)}


def test_composite_takes_the_nearer_and_zero_is_nothing() -> None:
    np.testing.assert_array_equal(
        composite(NEAR, FAR), image([0.5, 0.52, 0.5, 0.5], [0.605, 0.595, 0.6, 0.0])
    )


@given(st.integers(0, 2**31))
def test_the_order_of_composition_does_not_matter(seed: int) -> None:
    generator = np.random.default_rng(seed)
    a, b, c = (
        (generator.uniform(0.3, 1, (3, 4)) * generator.integers(0, 2, (3, 4))).astype(
            np.float32
        )
        for _ in range(3)
    )
    np.testing.assert_array_equal(
        composite(composite(a, b), c), composite(composite(c, a), b)
    )
    np.testing.assert_array_equal(composite(a, np.zeros_like(a)), a)


def test_the_score_counts_agreeing_pixels_of_the_foreground() -> None:
    renderer, _ = make_renderer()
    # Agrees in (0, 0); off by 2 cm in (0, 1); nothing of the foreground beside.
    assert renderer.score(renderer.image({0: np.eye(4)})) == 1
    # Agrees within 1 cm in both pixels of the second row.
    assert renderer.score(renderer.image({1: np.eye(4)})) == 2
    assert renderer.score(renderer.image(BOTH)) == 3
    assert renderer.score(renderer.image({})) == 0


def test_what_is_drawn_before_what_was_measured_intrudes() -> None:
    renderer, _ = make_renderer()
    depth = make_scene().depth
    assert renderer.intruding(depth) == 0
    assert renderer.intruding(np.maximum(depth - 0.009, 0)) == 0
    nearer = np.where(depth > 0, depth - 0.02, 0).astype(np.float32)
    assert renderer.intruding(nearer) == np.count_nonzero(depth)
    assert renderer.intruding(depth + np.float32(0.02)) == 0


def test_nothing_drawn_where_nothing_is_seen_is_no_agreement() -> None:
    renderer, _ = make_renderer()
    assert renderer.score(np.zeros_like(OBSERVED)) == 0
    assert renderer.score(OBSERVED) == 4


def test_the_gain_is_the_difference_that_an_object_makes() -> None:
    renderer, _ = make_renderer()
    for first, second in ((0, 1), (1, 0)):
        parent = renderer.image({first: np.eye(4)})
        gain = renderer.score(renderer.image(BOTH)) - renderer.score(parent)
        assert renderer.gain(parent, second, np.eye(4)) == gain


def test_an_object_that_hides_what_agreed_costs() -> None:
    renderer, fake = make_renderer()
    fake.images[7] = np.where(NEAR > 0, NEAR - np.float32(0.05), NEAR)
    assert renderer.gain(OBSERVED, 0, np.eye(4)) == -2


def test_labels_tell_who_is_in_front() -> None:
    renderer, _ = make_renderer()
    depth, labels = renderer.labels(BOTH)
    np.testing.assert_array_equal(labels, [[0, 0, 0, 0], [1, 1, 1, -1]])
    np.testing.assert_array_equal(depth, renderer.image(BOTH))


def test_confidences_by_hand() -> None:
    renderer, _ = make_renderer()
    found = renderer.confirmations(BOTH)
    # Of three visible pixels with depth one agrees, of two of the segment one.
    assert found[0] == Confirmation(1 / 3, 1 / 2)
    assert found[0].confidence == pytest.approx(1 / 3 * 1 / 2)
    # Two of three, and the whole segment.
    assert found[1] == Confirmation(2 / 3, 2 / 2)


def test_a_hidden_object_has_no_confidence() -> None:
    renderer, fake = make_renderer()
    fake.images[9] = image([0.9, 0.9, 0.9, 0.9], [0.0, 0.0, 0.0, 0.0])
    assert renderer.confirmations(BOTH)[1].confidence == 0


def test_objects_are_drawn_where_the_camera_sees_them() -> None:
    renderer, fake = make_renderer()
    X_SO = make_pose(p=[0.1, 0.2, 0.3])
    renderer.object_window(1, X_SO)
    ((object_id, X_CO),) = fake.calls
    assert object_id == 9
    np.testing.assert_allclose(X_CO, X_CS @ X_SO)


def test_windows_are_remembered_the_last_used_longest() -> None:
    renderer, fake = make_renderer(remembered=2)
    a, b, c = (make_pose(p=[0.1 * n, 0, 0]) for n in range(3))
    for X in (a, b, a, c, a):
        renderer.object_window(0, X)
    assert len(fake.calls) == 3
    renderer.object_window(0, b)
    assert len(fake.calls) == 4


def test_the_same_object_twice_in_a_scene_shares_its_windows() -> None:
    renderer, fake = make_renderer()
    renderer.object_window(0, np.eye(4))
    renderer.object_window(1, np.eye(4))
    renderer.object_window(0, np.eye(4))
    assert [object_id for object_id, _ in fake.calls] == [7, 9]
