# SPDX-License-Identifier: MIT
"""The estimated scene as the tool meets it: objects and walls, by their distance."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from physim_drake.objects.containers import Container
from physim_drake.objects.model import ObjectLibrary, ObjectModel
from physim_drake.poses import Array, inverse, make_pose, transform_points
from physim_drake.registration.registration_model import registration_model
from physim_drake.scene_estimate import SceneEstimate

_RING_POINTS = 12
_RING_STEP = 0.01  # m


@dataclass(frozen=True)
class PlacedObject:
    """An object of an estimate that has a pose.

    Attributes:
        index: index of the object in the estimate.
        model: model of the object.
        X_WO: pose of the object, (4, 4).
        confidence: the estimate's, 0..1.
    """

    index: int
    model: ObjectModel
    X_WO: Array
    confidence: float


def placed_objects(
    estimate: SceneEstimate, library: ObjectLibrary
) -> tuple[PlacedObject, ...]:
    """The objects of an estimate that were found."""
    return tuple(
        PlacedObject(n, library[o.object_id], o.X_WO, o.confidence)
        for n, o in enumerate(estimate.objects)
        if o.X_WO is not None
    )


@dataclass(frozen=True)
class Wall:
    """A box that stands in the cell: a side of a tote, a table.

    Attributes:
        X_WB: pose of its middle, (4, 4).
        size: along its axes, (3,), m.
    """

    X_WB: Array
    size: Array

    def distances(self, p_W: Array) -> Array:
        """Signed distances (N,) of points (N, 3), m, negative inside."""
        outside = (
            np.abs(transform_points(inverse(self.X_WB), p_W)) - np.array(self.size) / 2
        )
        beyond = np.linalg.norm(np.maximum(outside, 0.0), axis=1)
        return np.asarray(beyond + np.minimum(outside.max(axis=1), 0.0))


def container_walls(container: Container, X_WK: Array) -> tuple[Wall, ...]:
    """The boxes of a container.

    Args:
        container: the container, its boxes in its own frame K.
        X_WK: pose, (4, 4).
    """
    return tuple(Wall(X_WK @ make_pose(p=b.center), b.size) for b in container.boxes)


@dataclass(frozen=True)
class ToolShape:
    """The tool as cylinders about the cup's axis, for a first look at free space.

    Attributes:
        sections: (from, to, radius) of each, m behind the lip.
    """

    sections: tuple[tuple[float, float, float], ...] = (
        (0.002, 0.028, 0.015),
        (0.028, 0.150, 0.012),
        (0.150, 0.200, 0.022),
        (0.200, 0.260, 0.058),
    )

    def points(self) -> Array:
        """Points on the cylinders, in the frame of the cup, p_G (N, 3), m."""
        angles = 2 * np.pi * np.arange(_RING_POINTS) / _RING_POINTS
        ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(_RING_POINTS)], 1)
        rings = [
            ring * [radius, radius, 1.0] - [0.0, 0.0, height]
            for start, end, radius in self.sections
            for height in np.linspace(start, end, int((end - start) / _RING_STEP) + 2)
        ]
        return np.concatenate(rings)


def tool_clearance(
    X_WG: Array,
    tool: ToolShape,
    others: Sequence[PlacedObject],
    walls: Collection[Wall] = (),
    largest: float = 0.1,
) -> Array:
    """Distance of the tool at each pose to what is nearest.

    Args:
        X_WG: poses of the cup frame, (N, 4, 4).
        tool: shape of the tool.
        others: objects that it must not touch.
        walls: boxes that it must not touch.
        largest: distances beyond it are cut off, m.

    Returns:
        (N,), m, negative if the tool is in something. It is taken at points of the
        tool's surface 1 cm apart, so something slender may be nearer.
    """
    points = tool.points()
    p_W = transform_points(X_WG, points).reshape(-1, 3)
    nearest = np.full(len(p_W), largest)
    for item in others:
        field = registration_model(item.model).distance_field
        d, _ = field.query(transform_points(inverse(item.X_WO), p_W))
        nearest = np.minimum(nearest, d)
    for wall in walls:
        nearest = np.minimum(nearest, wall.distances(p_W))
    return np.asarray(nearest.reshape(len(X_WG), len(points)).min(axis=1))
