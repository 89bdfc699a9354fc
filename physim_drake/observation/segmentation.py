# SPDX-License-Identifier: MIT
"""From detections to segments: each object's points, clean and with normals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from physim_drake.camera import CameraIntrinsics, DepthImage
from physim_drake.observation.observation import Detection, RgbdObservation, Segment
from physim_drake.observation.support_surface import SupportSurface, depth_tolerance
from physim_drake.observation.voxels import voxel_means
from physim_drake.poses import Array, transform_points

_VOXEL = 0.003
_OUTLIER_RADIUS = 0.03
_OUTLIER_NEIGHBOURS = 10
_NORMAL_NEIGHBOURS = 25
_MIN_HEIGHT = 0.003


def foreground(observation: RgbdObservation, surface: SupportSurface) -> DepthImage:
    """The depth image (m) with the support surface and what is below it set to 0."""
    p_C = observation.intrinsics.unproject(observation.depth)
    normal = surface.X_CS[:3, 2]
    heights = p_C @ normal - normal @ surface.X_CS[:3, 3]
    noise = depth_tolerance(observation.depth.astype(float))
    # A depth error shifts the height by its share along the normal.
    share = np.abs(observation.intrinsics.rays() @ normal)
    above = heights > np.maximum(_MIN_HEIGHT, 2.5 * noise * share)
    return np.where(above, observation.depth, np.float32(0))


def segment_objects(
    observed: DepthImage,
    intrinsics: CameraIntrinsics,
    surface: SupportSurface,
    detections: Sequence[Detection],
) -> list[Segment]:
    """Cuts each detection's points out of the cloud.

    Points with fewer than ten neighbours within 3 cm go, and the rest is thinned to
    3 mm. A segment may end up empty.

    Args:
        observed: depth image, m, 0 for the support surface (see `foreground`).
        intrinsics: of the camera.
        surface: whose frame the points are given in.
        detections: where the objects are.
    """
    p_C = intrinsics.unproject(observed)
    camera_S = surface.X_SC[:3, 3]
    segments = []
    for detection in detections:
        mask = detection.pixels(*observed.shape) & (observed > 0)
        points = voxel_means(transform_points(surface.X_SC, p_C[mask]), _VOXEL)
        points = _without_outliers(points)
        normals = estimate_normals(points, camera_S)
        segments.append(Segment(detection, points, normals, mask))
    return segments


def _without_outliers(points: Array) -> Array:
    if len(points) <= _OUTLIER_NEIGHBOURS:
        return points[:0]
    neighbours = cKDTree(points).query_ball_point(
        points, _OUTLIER_RADIUS, return_length=True
    )
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
