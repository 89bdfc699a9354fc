# SPDX-License-Identifier: MIT
"""From detections to segments: each object's points, clean and with normals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from physim_drake.camera import CameraIntrinsics, DepthImage
from physim_drake.observation.object_sizes import UNKNOWN_SIZES, ObjectSizes
from physim_drake.observation.observation import Detection, RgbdObservation, Segment
from physim_drake.observation.support_surface import SupportSurface, depth_tolerance
from physim_drake.observation.voxels import voxel_means
from physim_drake.poses import Array, transform_points

_VOXEL = 0.003
_OUTLIER_RADIUS = 0.03
_OUTLIER_NEIGHBOURS = 10
_NORMAL_NEIGHBOURS = 25
_MIN_HEIGHT = 0.003
_RADIUS_IN_PIXELS = 4  # of the outlier radius, at least
_THIN = 0.5  # of an object's thickness: it is no lower


def foreground(
    observation: RgbdObservation,
    surface: SupportSurface,
    detections: Sequence[Detection] = (),
    sizes: ObjectSizes = UNKNOWN_SIZES,
) -> DepthImage:
    """The depth image (m) with the support surface and what is below it set to 0.

    Where an object is detected that is thinner than what counts as the surface, half
    its thickness counts as the object.
    """
    p_C = observation.intrinsics.unproject(observation.depth)
    normal = surface.X_CS[:3, 2]
    heights = p_C @ normal - normal @ surface.X_CS[:3, 3]
    noise = depth_tolerance(observation.depth.astype(float))
    # A depth error shifts the height by its share along the normal.
    share = np.abs(observation.intrinsics.rays() @ normal)
    least = np.maximum(_MIN_HEIGHT * sizes.factor, 2.5 * noise * share)
    for detection in detections:
        if detection.object_id in sizes.thicknesses:
            thin = _THIN * sizes.thicknesses[detection.object_id]
            pixels = detection.pixels(*least.shape)
            least[pixels] = np.minimum(least[pixels], thin)
    above = heights > least
    return np.where(above, observation.depth, np.float32(0))


def foreground_in_air(
    observation: RgbdObservation,
    detections: Sequence[Detection],
    sizes: ObjectSizes = UNKNOWN_SIZES,
) -> DepthImage:
    """The depth image (m) of the detected objects alone, the rest set to 0.

    What a box shows a diameter behind its nearest pixels is not its object.
    """
    depth = observation.depth
    kept = np.zeros(depth.shape, dtype=bool)
    for detection in detections:
        pixels = detection.pixels(*depth.shape) & (depth > 0)
        diameter = sizes.diameters.get(detection.object_id)
        if detection.mask is None and diameter is not None and pixels.any():
            nearest = np.percentile(depth[pixels], 5)
            pixels &= depth < nearest + diameter
        kept |= pixels
    return np.where(kept, depth, np.float32(0))


def segment_objects(
    observed: DepthImage,
    intrinsics: CameraIntrinsics,
    surface: SupportSurface,
    detections: Sequence[Detection],
    factor: float = 1.0,
) -> list[Segment]:
    """Cuts each detection's points out of the cloud.

    Points with fewer than ten neighbours within 3 cm go, and the rest is thinned to
    3 mm. The radius is at least four pixels. A segment may end up empty.

    Args:
        observed: depth image, m, 0 for the support surface (see `foreground`).
        intrinsics: of the camera.
        surface: whose frame the points are given in.
        detections: where the objects are.
        factor: by which both lengths are multiplied, see `ObjectSizes`.
    """
    p_C = intrinsics.unproject(observed)
    camera_S = surface.X_SC[:3, 3]
    segments = []
    for detection in detections:
        mask = detection.pixels(*observed.shape) & (observed > 0)
        points = voxel_means(transform_points(surface.X_SC, p_C[mask]), _VOXEL * factor)
        points = _without_outliers(points, _radius(p_C[mask], intrinsics, factor))
        normals = estimate_normals(points, camera_S)
        segments.append(Segment(detection, points, normals, mask))
    return segments


def _radius(p_C: Array, intrinsics: CameraIntrinsics, factor: float) -> float:
    """Within which a point needs neighbours, m, among points (N, 3) in C."""
    if len(p_C) == 0:
        return _OUTLIER_RADIUS * factor
    pixel = float(np.median(p_C[:, 2])) / min(intrinsics.fx, intrinsics.fy)
    return max(_OUTLIER_RADIUS * factor, _RADIUS_IN_PIXELS * pixel)


def _without_outliers(points: Array, radius: float) -> Array:
    if len(points) <= _OUTLIER_NEIGHBOURS:
        return points[:0]
    neighbours = cKDTree(points).query_ball_point(points, radius, return_length=True)
    return np.asarray(points[neighbours > _OUTLIER_NEIGHBOURS])


def estimate_normals(points: Array, camera: Array) -> Array:
    """Unit normals (N, 3) by local planes, turned towards the `camera` (3,)."""
    if len(points) < 3:
        return np.zeros((len(points), 3))
    count = min(_NORMAL_NEIGHBOURS, len(points))
    neighbours = points[cKDTree(points).query(points, k=count)[1]]
    centred = neighbours - neighbours.mean(axis=1, keepdims=True)
    covariance = np.einsum("nki,nkj->nij", centred, centred)
    normals = np.linalg.eigh(covariance)[1][:, :, 0]
    away = np.einsum("ni,ni->n", normals, camera - points) < 0
    normals[away] *= -1
    return np.asarray(normals)
