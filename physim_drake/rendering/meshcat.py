# SPDX-License-Identifier: MIT
"""Draws observed points and estimated objects in Meshcat."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydrake.geometry import Meshcat, Rgba
from pydrake.math import RigidTransform
from pydrake.perception import BaseField, Fields, PointCloud

from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.observation import RgbdObservation
from physim_drake.poses import Array, transform_points
from physim_drake.scene_estimate import SceneEstimate


def draw_estimate(
    meshcat: Meshcat,
    path: str,
    estimate: SceneEstimate,
    library: ObjectLibrary,
    opacity: float = 0.5,
) -> None:
    """Draws the found objects at their estimated poses in the world.

    Each is coloured from red to green by its confidence. Its path is
    ``<path>/<index> <name> <confidence>``.

    Args:
        meshcat: Meshcat to draw in.
        path: path above the objects. What was below it is deleted.
        estimate: estimate whose objects are drawn.
        library: models of the objects.
        opacity: opacity, from 0 for invisible to 1 for opaque.
    """
    meshcat.Delete(path)
    for index, item in enumerate(estimate.objects):
        if item.X_WO is None:
            continue
        mesh = library[item.object_id].mesh
        vertices: Any = np.asarray(mesh.vertices, dtype=float).T
        faces: Any = np.asarray(mesh.faces, dtype=np.int32).T
        name = f"{path}/{index} {item.name} {item.confidence:.2f}"
        meshcat.SetTriangleMesh(
            name,
            vertices,
            faces,
            confidence_color(item.confidence, opacity),
        )
        meshcat.SetTransform(name, RigidTransform(item.X_WO))


def confidence_color(confidence: float, opacity: float = 1.0) -> Rgba:
    """Red for 0, yellow for a half, green for 1."""
    share = float(np.clip(confidence, 0.0, 1.0))
    return Rgba(min(1.0, 2 - 2 * share), min(1.0, 2 * share), 0.0, opacity)


def draw_cloud(
    meshcat: Meshcat,
    path: str,
    observation: RgbdObservation,
    X_WC: Array,
    stride: int = 2,
    point_size: float = 0.002,
) -> None:
    """Draws the points of an image in the world, in their colours.

    Args:
        meshcat: Meshcat to draw in.
        path: path of the cloud.
        observation: image. Without colour its points are grey.
        X_WC: pose of the camera, (4, 4).
        stride: step between pixels that are drawn, along rows and columns.
        point_size: size of a point, m.
    """
    every = (slice(None, None, stride), slice(None, None, stride))
    depth = observation.depth[every]
    p_C = observation.intrinsics.unproject(observation.depth)[every][depth > 0]
    fields: Any = BaseField.kXYZs | BaseField.kRGBs
    cloud: Any = PointCloud(len(p_C), Fields(fields))
    cloud.mutable_xyzs()[:] = transform_points(X_WC, p_C).T
    color = observation.color
    cloud.mutable_rgbs()[:] = 128 if color is None else color[every][depth > 0].T
    meshcat.SetObject(path, cloud, point_size=point_size)
