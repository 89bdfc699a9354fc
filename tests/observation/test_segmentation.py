# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.spatial import cKDTree

from physim_drake.observation.observation import Detection, Segment
from physim_drake.observation.segmentation import (
    estimate_normals,
    foreground,
    segment_objects,
)
from physim_drake.poses import Array, inverse, transform_points
from physim_drake.registration.registration_model import registration_model
from tests.synthetic import (
    X_WC,
    SyntheticScene,
    library,
    pair_apart,
    synthesize,
)


@cache
def made() -> SyntheticScene:
    return synthesize(pair_apart(), noise=0.5)


def segments_of(scene: SyntheticScene) -> list[Segment]:
    observed = foreground(scene.observation, scene.surface)
    return segment_objects(
        observed, scene.observation.intrinsics, scene.surface, scene.detections
    )


def distances_to_object(scene: SyntheticScene, k: int, points: Array) -> Array:
    model = library()[scene.detections[k].object_id]
    p_O = transform_points(inverse(scene.X_SO[k]), points)
    return np.abs(registration_model(model).distance_field.query(p_O)[0])


def test_the_foreground_is_the_objects() -> None:
    scene = made()
    observed = foreground(scene.observation, scene.surface)
    objects = np.logical_or.reduce(scene.masks)
    assert (observed[~objects] > 0).mean() < 0.003
    assert (observed[objects] > 0).mean() > 0.85
    kept = observed > 0
    np.testing.assert_array_equal(observed[kept], scene.observation.depth[kept])


def test_low_objects_stay_in_the_foreground_seen_from_the_side() -> None:
    scene = made()
    observed = foreground(scene.observation, scene.surface)
    p_C = scene.observation.intrinsics.unproject(scene.ideal_depth)
    heights = transform_points(X_WC, p_C.reshape(-1, 3))[:, 2].reshape(observed.shape)
    clearly_above = (heights > 0.012) & np.logical_or.reduce(scene.masks)
    assert (observed[clearly_above] > 0).all()


def test_segments_lie_on_their_objects() -> None:
    for k, segment in enumerate(segments_of(made())):
        assert len(segment.points) > 100
        distances = distances_to_object(made(), k, segment.points)
        assert np.percentile(distances, 98) < 0.005


def test_segments_hold_no_table_points() -> None:
    for segment in segments_of(made()):
        assert segment.points[:, 2].min() > 0.002


def test_lone_points_are_dropped() -> None:
    scene = made()
    depth = scene.observation.depth.copy()
    left, top, right, _ = scene.detections[0].box.astype(int)
    stray = np.array([[top, left], [top + 1, right - 1], [top, left + 7]])
    depth[stray[:, 0], stray[:, 1]] -= 0.15
    dirty = replace(scene, observation=replace(scene.observation, depth=depth))
    segment = segments_of(dirty)[0]
    assert distances_to_object(scene, 0, segment.points).max() < 0.02
    # The mask still has every pixel of the segment.
    assert segment.mask[stray[:, 0], stray[:, 1]].all()


def test_points_are_thinned() -> None:
    segment = segments_of(made())[1]
    assert len(segment.points) < 0.9 * segment.mask.sum()
    cells = np.unique(np.floor(segment.points / 0.003), axis=0)
    assert len(cells) == len(segment.points)
    pixels = transform_points(
        made().surface.X_SC,
        made().observation.intrinsics.unproject(made().observation.depth)[segment.mask],
    )
    assert cKDTree(segment.points).query(pixels)[0].max() < 0.006


def test_normals_are_unit_and_look_at_the_camera() -> None:
    camera = made().surface.X_SC[:3, 3]
    for k, segment in enumerate(segments_of(made())):
        lengths = np.linalg.norm(segment.normals, axis=1)
        np.testing.assert_allclose(lengths, 1, atol=1e-9)
        towards = np.einsum("ni,ni->n", segment.normals, camera - segment.points)
        assert (towards >= 0).all()
        model = registration_model(library()[made().detections[k].object_id])
        X_SO = made().X_SO[k]
        _, gradients = model.distance_field.query(
            transform_points(inverse(X_SO), segment.points)
        )
        cosines = np.einsum("ni,ni->n", gradients @ X_SO[:3, :3].T, segment.normals)
        assert np.median(cosines) > 0.97


def test_normals_of_a_plane_are_exact() -> None:
    generator = np.random.default_rng(0)
    points = np.concatenate([generator.uniform(size=(50, 2)), np.ones((50, 1))], axis=1)
    below = estimate_normals(points, np.array([0.5, 0.5, -3.0]))
    np.testing.assert_allclose(below, np.tile([0.0, 0.0, -1.0], (50, 1)), atol=1e-9)


def test_a_detection_of_nothing_gives_an_empty_segment() -> None:
    scene = made()
    empty = Detection(1, np.array([0.0, 0.0, 5.0, 5.0]))
    observed = foreground(scene.observation, scene.surface)
    (segment,) = segment_objects(
        observed, scene.observation.intrinsics, scene.surface, [empty]
    )
    assert segment.points.shape == segment.normals.shape == (0, 3)
    assert not segment.mask.any()


def test_a_mask_cuts_more_sharply_than_its_box() -> None:
    scene = made()
    whole = np.array([0.0, 0.0, 320.0, 240.0])
    detection = Detection(scene.detections[0].object_id, whole, mask=scene.masks[0])
    observed = foreground(scene.observation, scene.surface)
    (segment,) = segment_objects(
        observed, scene.observation.intrinsics, scene.surface, [detection]
    )
    assert distances_to_object(scene, 0, segment.points).max() < 0.02
