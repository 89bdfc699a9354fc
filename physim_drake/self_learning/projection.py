# SPDX-License-Identifier: MIT
"""Labels for images from known poses: what of each object an image must show.

Objects are drawn with their occlusion of each other, and compared with the measured
depth. What is measured before a model hides it, what is measured behind it refutes it,
and what rises from the surface without a model is unknown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from physim_drake.datasets.bop_writer import BopImage
from physim_drake.objects.model import ObjectModel
from physim_drake.observation.observation import Detection, Mask, RgbdObservation
from physim_drake.observation.support_surface import depth_tolerance
from physim_drake.poses import Array, inverse, transform_points
from physim_drake.rendering.raster import DepthRasterizer
from physim_drake.self_learning.agreement import AgreedObject

_EDGE = 2  # px beside an outline, within which a pixel may belong to either side
_FRAYED = 5  # px, by which a measured object is larger than its model
_SPECK = 5  # px, up to which what rises is noise
_REACH = 12  # px beside the unknown, within which what was not measured belongs to it
_HIDDEN = 7  # px, by which what is unknown is hidden more widely than it is measured


@dataclass(frozen=True)
class ObjectArea:
    """The part of the surface on which all objects stand.

    Attributes:
        X_WA: pose of the area, z up, (4, 4).
        half_extents: half its size along x and y, (2,), m.
        height: height above which nothing belongs to an object, m.
    """

    X_WA: Array
    half_extents: Array
    height: float = 0.3

    def rises(self, observation: RgbdObservation) -> Mask:
        """The pixels (height, width) that show something on the area."""
        assert observation.X_WC is not None, "views are taken from known places"
        depth = observation.depth
        p_C = observation.intrinsics.unproject(depth)
        X_AC = inverse(self.X_WA) @ observation.X_WC
        p_A = transform_points(X_AC, p_C.reshape(-1, 3)).reshape(p_C.shape)
        least = np.maximum(0.004, 3 * depth_tolerance(depth.astype(float)))
        inside = (np.abs(p_A[..., :2]) <= self.half_extents).all(axis=-1)
        above = (p_A[..., 2] > least) & (p_A[..., 2] < self.height)
        return np.asarray((depth > 0) & inside & above)


@dataclass(frozen=True)
class ProjectedObjects:
    """What an image must show of objects.

    Attributes:
        depth: depth of the models, (height, width), m, 0 beside them.
        silhouettes: pixels that each object would cover alone, (N, height, width).
        visible: pixels in which each object must be seen, (N, height, width).
        hidden: pixels before which something else was measured, (height, width).
        refuted: share of each object's measured pixels behind which something was
            measured, (N,). It is 0 if no pixel was measured.
        measured: number of each object's measured pixels off its outline, (N,).
    """

    depth: NDArray[np.float32]
    silhouettes: NDArray[np.bool_]
    visible: NDArray[np.bool_]
    hidden: Mask
    refuted: Array
    measured: Array


def project_objects(
    objects: Sequence[AgreedObject],
    models: Mapping[int, ObjectModel],
    observation: RgbdObservation,
    margin: float,
) -> ProjectedObjects:
    """Draws objects into an image.

    Args:
        objects: objects with their poses.
        models: models by id.
        observation: image with a known X_WC.
        margin: difference up to which depths agree, m.
    """
    assert observation.X_WC is not None, "views are taken from known places"
    rasterizer = DepthRasterizer(models, observation.intrinsics)
    measured = observation.depth
    depth = np.zeros_like(measured)
    labels = np.full(depth.shape, -1, np.int16)
    silhouettes = np.zeros((len(objects), *depth.shape), bool)
    for n, item in enumerate(objects):
        X_CO = inverse(observation.X_WC) @ item.X_WO
        window = rasterizer.window(item.object_id, X_CO)
        covered = window.depth > 0
        window.of(silhouettes[n])[covered] = True
        drawn = window.of(depth)
        nearer = covered & ((drawn == 0) | (window.depth < drawn))
        drawn[nearer] = window.depth[nearer]
        window.of(labels)[nearer] = n
    known = (measured > 0) & (depth > 0)
    hidden = known & (measured < depth - margin)
    behind = known & (measured > depth + margin)
    refuted, counts = np.zeros(len(objects)), np.zeros(len(objects))
    for n in range(len(objects)):
        inner = _eroded(labels == n) & known & ~hidden
        counts[n] = inner.sum()
        refuted[n] = (inner & behind).sum() / max(counts[n], 1)
    visible = (labels == np.arange(len(objects))[:, None, None]) & ~hidden
    return ProjectedObjects(depth, silhouettes, visible, hidden, refuted, counts)


def unknown_pixels(
    projected: ProjectedObjects,
    observation: RgbdObservation,
    detections: Sequence[Detection],
    area: ObjectArea,
) -> Mask:
    """The pixels (height, width) that may show an object without a label.

    In these, something rises from the area that does not belong to any model, or the
    detector sees something whose depth was not measured.
    """
    labelled = projected.visible.any(axis=0)
    modelled = _dilated(projected.depth > 0, _FRAYED)
    rises = area.rises(observation)
    unknown = rises & (~modelled | projected.hidden)
    for detection in detections:
        inside = detection.pixels(*labelled.shape)
        unknown |= inside & (observation.depth == 0) & ~modelled
    kernel = np.ones((_SPECK, _SPECK), np.uint8)
    solid = cv2.morphologyEx(unknown.astype(np.uint8), cv2.MORPH_OPEN, kernel)
    unmeasured = _dilated(solid > 0, _REACH) & (observation.depth == 0)
    return np.asarray(_dilated((solid > 0) | unmeasured, _HIDDEN) & ~labelled)


def labelled_image(
    objects: Sequence[AgreedObject],
    projected: ProjectedObjects,
    observation: RgbdObservation,
    unknown: Mask,
    min_pixels: int,
) -> BopImage:
    """The image with labels, and with what is unknown painted over.

    A network that learns from it must not take objects without a label for background.
    It sees a patch of the image's median colour instead, and no depth.

    Args:
        objects: objects that were projected.
        projected: projection into this image.
        observation: image with colour.
        unknown: pixels that `unknown_pixels` gives.
        min_pixels: visible pixels below which an object gets no label.
    """
    assert observation.X_WC is not None, "views are taken from known places"
    assert observation.color is not None, "detectors look at colour"
    color, depth = observation.color.copy(), observation.depth.copy()
    if unknown.any() and not unknown.all():
        color[unknown] = np.median(observation.color[~unknown], axis=0)
        depth[unknown] = 0.0
    counts = projected.visible.sum(axis=(1, 2))
    shown = [n for n in range(len(objects)) if counts[n] >= min_pixels]
    X_CW = inverse(observation.X_WC)
    poses = [X_CW @ objects[n].X_WO for n in shown]
    return BopImage(
        replace(observation, color=color, depth=depth),
        [objects[n].object_id for n in shown],
        np.reshape(poses, (-1, 4, 4)),
        projected.silhouettes[shown],
        projected.visible[shown],
    )


def _dilated(mask: Mask, pixels: int) -> Mask:
    kernel = np.ones((2 * pixels + 1, 2 * pixels + 1), np.uint8)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), kernel) > 0)


def _eroded(mask: Mask) -> Mask:
    kernel = np.ones((2 * _EDGE + 1, 2 * _EDGE + 1), np.uint8)
    return np.asarray(cv2.erode(mask.astype(np.uint8), kernel) > 0)
