# SPDX-License-Identifier: MIT
from __future__ import annotations

import pickle

import numpy as np

from tests.synthetic import GLUE, SOAP, pair_apart, synthesize


def test_a_scene_has_a_segment_for_each_detection() -> None:
    made = synthesize(pair_apart())
    scene = made.scene()
    assert scene.object_ids == (GLUE, SOAP)
    for segment, mask in zip(scene.segments, made.masks, strict=True):
        # All but the lowest of its pixels, and no other's.
        assert (segment.mask & mask).sum() > 0.85 * mask.sum()
        assert (segment.mask & ~mask).sum() < 0.02 * mask.sum()


def test_a_scene_keeps_the_measured_depth_beside_the_foreground() -> None:
    made = synthesize(pair_apart())
    scene = made.scene()
    np.testing.assert_array_equal(scene.depth, made.observation.depth)
    foreground = scene.observed > 0
    np.testing.assert_array_equal(scene.observed[foreground], scene.depth[foreground])
    assert foreground.mean() < 0.3


def test_a_scene_can_be_sent_to_a_worker() -> None:
    scene = synthesize(pair_apart()).scene()
    sent = pickle.loads(pickle.dumps(scene))
    np.testing.assert_array_equal(sent.observed, scene.observed)
    assert sent.object_ids == scene.object_ids
