# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physim_drake.observation.observation import Detection, Mask
from physim_drake.poses import make_pose
from physim_drake.self_learning.agreement import AgreedObject
from physim_drake.self_learning.labels import SelfLearningConfig
from physim_drake.self_learning.projection import (
    labelled_image,
    project_objects,
    unknown_pixels,
)
from tests.self_learning.views import AREA, CAMERAS, seen_from
from tests.synthetic import (
    ERASER,
    SOAP,
    Objects,
    SyntheticScene,
    library,
    pair_apart,
    stack,
)

MARGIN = SelfLearningConfig().margin


def agreed(objects: Objects) -> list[AgreedObject]:
    return [AgreedObject(i, X, 1.0, (0, 1)) for i, X in objects]


def overlap(one: Mask, other: Mask) -> float:
    return float((one & other).sum() / (one | other).sum())


def unknown_of(scene: SyntheticScene, observation, known: Objects, detections=()):
    drawn = project_objects(agreed(known), library(), observation, MARGIN)
    return drawn, unknown_pixels(drawn, observation, detections, AREA)


@pytest.mark.parametrize("camera", range(len(CAMERAS)))
@pytest.mark.parametrize("objects", [stack(), pair_apart()], ids=["stack", "apart"])
def test_visible_masks_are_the_true_ones(objects: Objects, camera: int):
    scene, observation = seen_from(objects, CAMERAS[camera])
    drawn = project_objects(agreed(objects), library(), observation, MARGIN)
    for n, mask in enumerate(scene.masks):
        assert overlap(drawn.visible[n], mask) > 0.97
        assert (drawn.visible[n] <= drawn.silhouettes[n]).all()
    assert (drawn.refuted < 0.02).all()
    assert (drawn.measured > 200).all()


def test_known_objects_hide_each_other():
    """The soap lies on the eraser: it shows all of itself, the eraser a part."""
    _, observation = seen_from(stack(), CAMERAS[0])
    drawn = project_objects(agreed(stack()), library(), observation, MARGIN)
    hidden = drawn.silhouettes[0] & ~drawn.visible[0]
    assert hidden.sum() > 300
    assert drawn.visible[1][hidden].mean() > 0.95
    assert drawn.visible[1].sum() == pytest.approx(drawn.silhouettes[1].sum(), rel=0.02)


def test_what_is_measured_before_an_object_hides_it():
    """The soap is not among the known objects, but it is in the way."""
    scene, observation = seen_from(stack(), CAMERAS[0])
    drawn, unknown = unknown_of(scene, observation, stack()[:1])
    assert overlap(drawn.visible[0], scene.masks[0]) > 0.93
    assert drawn.refuted[0] < 0.05
    # And it must not be taken for background.
    assert unknown[scene.masks[1]].mean() > 0.95
    assert not (unknown & drawn.visible[0]).any()


def test_what_is_seen_through_is_refuted():
    _, observation = seen_from(pair_apart()[:1], CAMERAS[0])
    absent = pair_apart()[1]
    drawn = project_objects(agreed([absent]), library(), observation, MARGIN)
    assert drawn.refuted[0] > 0.6


def test_what_was_not_measured_refutes_nothing():
    _, observation = seen_from(pair_apart()[:1], CAMERAS[0])
    depth = observation.depth.copy()
    depth[:, 160:] = 0
    drawn = project_objects(
        agreed(pair_apart()[1:]), library(), replace(observation, depth=depth), MARGIN
    )
    assert drawn.refuted[0] == 0
    assert drawn.visible[0].sum() > 500


def test_nothing_is_unknown_where_all_is_known():
    for camera in CAMERAS:
        scene, observation = seen_from(stack(), camera)
        _, unknown = unknown_of(scene, observation, stack())
        assert unknown.mean() < 0.001


def test_an_object_without_a_model_is_unknown_the_table_is_not():
    scene, observation = seen_from(pair_apart(), CAMERAS[1])
    drawn, unknown = unknown_of(scene, observation, pair_apart()[1:])
    assert unknown[scene.masks[0]].mean() > 0.97
    assert not unknown[scene.masks[1]].any()
    assert unknown.mean() < 3 * scene.masks[0].mean()
    assert drawn.visible.shape[0] == 1


def test_what_stands_outside_the_area_is_background():
    _, observation = seen_from(pair_apart(), CAMERAS[0])
    far = replace(AREA, X_WA=make_pose(p=[3.0, 0.0, 0.0]))
    drawn = project_objects([], library(), observation, MARGIN)
    assert not unknown_pixels(drawn, observation, (), far).any()
    assert unknown_pixels(drawn, observation, (), AREA).any()


def test_a_detection_whose_depth_is_missing_is_unknown():
    """Black plastic is seen by the colour camera alone."""
    scene, observation = seen_from(pair_apart()[:1], CAMERAS[0])
    dark = replace(
        observation, depth=np.where(scene.masks[0], np.float32(0), observation.depth)
    )
    _, unknown = unknown_of(scene, dark, [])
    assert not unknown[scene.masks[0]].any()
    detection = Detection(SOAP, scene.detections[0].box, 0.9, scene.masks[0])
    _, unknown = unknown_of(scene, dark, [], [detection])
    assert unknown[scene.masks[0]].all()


def test_what_is_unknown_is_painted_over():
    scene, observation = seen_from(stack(), CAMERAS[0])
    known = stack()[:1]
    drawn, unknown = unknown_of(scene, observation, known)
    image = labelled_image(agreed(known), drawn, observation, unknown, 100)
    assert image.object_ids == [ERASER]
    assert image.observation.color is not None
    assert observation.color is not None
    assert len(np.unique(image.observation.color[unknown], axis=0)) == 1
    assert not image.observation.depth[unknown].any()
    kept = ~unknown
    np.testing.assert_array_equal(
        image.observation.color[kept], observation.color[kept]
    )
    np.testing.assert_array_equal(
        image.observation.depth[kept], observation.depth[kept]
    )


def test_an_object_that_hardly_shows_gets_no_label():
    scene, observation = seen_from(pair_apart(), CAMERAS[0])
    drawn, unknown = unknown_of(scene, observation, pair_apart())
    sizes = drawn.visible.sum(axis=(1, 2))
    limit = int(sizes.min()) + 1
    image = labelled_image(agreed(pair_apart()), drawn, observation, unknown, limit)
    assert image.object_ids == [pair_apart()[int(sizes.argmax())][0]]
    assert len(image.X_CO) == len(image.visible) == len(image.silhouettes) == 1
    none = labelled_image(agreed(pair_apart()), drawn, observation, unknown, 10**6)
    assert none.object_ids == []
    assert none.X_CO.shape == (0, 4, 4)
