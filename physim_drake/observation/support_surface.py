# SPDX-License-Identifier: MIT
"""The support surface: the plane the objects rest on, whose normal is gravity's.

The calibrated vertical may be degrees off; the plane in the cloud is not (in the
original authors' scene the two differ by 3.6 degrees). It is found by RANSAC among
planes that have the objects not far above them and nothing below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from physim_drake.camera import DepthImage
from physim_drake.errors import InputError
from physim_drake.observation.carrying_plane import (
    NoSurfaceError as NoSurfaceError,
)
from physim_drake.observation.carrying_plane import (
    carrying_plane,
    fitted_plane,
)
from physim_drake.observation.carrying_plane import (
    depth_tolerance as depth_tolerance,
)
from physim_drake.observation.object_sizes import UNKNOWN_SIZES, ObjectSizes
from physim_drake.observation.observation import Detection, Mask, RgbdObservation
from physim_drake.observation.voxels import first_in_voxels
from physim_drake.poses import Array, inverse, make_pose, transform_points

_VOXEL = 0.01
_MAX_RANGE = 3.0
_RANGE_OF_OBJECTS = 1.5  # of the distance of the objects, if they are far
_BEHIND = 0.1  # m; what lies farther behind the middle of a box is not its object
_LEAST_BESIDE = 0.05  # of a surface's points: beside the objects, not on them


@dataclass(frozen=True)
class SupportSurface:
    """The plane z = 0 of the support frame S.

    Attributes:
        X_CS: pose of S in the camera, (4, 4): origin where the optical axis meets the
            plane, z along its normal towards the camera, x near the camera's x.
        X_WS: the same in the world; the identity where no camera pose is known.
        known: False if nothing is known to carry the objects. S then lies behind all
            that the image shows, and faces the camera; where no camera pose is known,
            the world is the camera.
        warning: what is doubtful about the surface or the camera's pose, else empty.
    """

    X_CS: Array
    X_WS: Array
    known: bool = True
    warning: str = ""

    @property
    def X_SC(self) -> Array:
        """The camera's pose in S, (4, 4)."""
        return inverse(self.X_CS)


def surface_at_height(observation: RgbdObservation, height: float) -> SupportSurface:
    """The horizontal plane at `height` (m) in the world.

    Raises:
        InputError: where the camera's pose is unknown.
    """
    if observation.X_WC is None:
        raise InputError(
            observation.name,
            "a surface height needs the camera's pose, and there is none",
            "give cam_R_w2c and cam_t_w2c, or find the surface (auto)",
            "surface",
        )
    normal_C = observation.X_WC[:3, :3].T @ np.array([0.0, 0.0, 1.0])
    camera_height = observation.X_WC[2, 3] - height
    return _surface_from_plane(normal_C, float(camera_height), observation.X_WC)


def no_surface(observation: RgbdObservation, why: str = "") -> SupportSurface:
    """What stands for the surface if nothing is known to carry the objects.

    Args:
        observation: the image.
        why: reason, for the warning; empty if it is so by choice.
    """
    X_CS = make_pose(np.diag([1.0, -1.0, -1.0]), [0, 0, 2 * observation.depth.max()])
    X_WC = np.eye(4) if observation.X_WC is None else observation.X_WC
    warning = "no support surface" + (f" ({why})" if why else "")
    warning += ": nothing carries the objects, their poses are found without gravity"
    return SupportSurface(X_CS, X_WC @ X_CS, False, warning)


def find_support_surface(
    observation: RgbdObservation,
    detections: Sequence[Detection] = (),
    generator: np.random.Generator | None = None,
    sizes: ObjectSizes = UNKNOWN_SIZES,
) -> SupportSurface:
    """Finds the plane that carries the detected objects.

    Args:
        observation: the image; with a camera pose only planes within 30 degrees of
            the horizontal count, unless the image contradicts it: the surface then
            says so (`SupportSurface.warning`).
        detections: where objects are; the cloud around them decides. Without any, the
            dominant plane of the image is taken.
        generator: for the random samples.
        sizes: of the objects; the lengths of the search follow them.

    Raises:
        NoSurfaceError: if no plane carries the objects.
        InputError: if nothing is measured where the objects are.
    """
    generator = np.random.default_rng(0) if generator is None else generator
    distance = sizes.distance(observation, detections)
    reach = max(_MAX_RANGE, _RANGE_OF_OBJECTS * distance)
    factor = sizes.factor
    cloud, objects = _cloud_near(observation, detections, reach, factor)
    points = _thinned(cloud, 4000, factor, generator)
    if len(points) < 100:
        measured = observation.depth[observation.depth > 0]
        far = f"{np.median(measured):.3g} m" if len(measured) else "nothing"
        failure = NoSurfaceError if len(objects) else InputError
        raise failure(
            observation.name,
            f"only {len(points)} depth points near the objects that are less than "
            f"{reach:g} m away; the whole image shows {far} (median)",
            "check the detections, the depth image and its unit (depth_scale)",
            "surface",
        )
    up_C = None if observation.X_WC is None else observation.X_WC[:3, :3].T[:, 2]
    normal, offset, doubted = carrying_plane(
        points, _thinned(objects, 1000, factor, generator), up_C, factor, generator
    )
    for scale in (3.0, 2.0, 2.0):
        heights = cloud @ normal + offset
        inliers = np.abs(heights) < scale * depth_tolerance(cloud[:, 2]) + 0.001
        normal, offset = fitted_plane(
            cloud[inliers], 1 / depth_tolerance(cloud[inliers, 2])
        )
    if len(objects):
        _check_beside(observation, detections, normal, offset)
    surface = _surface_from_plane(normal, offset, observation.X_WC)
    return replace(surface, warning=_CONTRADICTED) if doubted else surface


_CONTRADICTED = (
    "the camera's pose (cam_R_w2c) contradicts the image: in it z of the world is not "
    "up from the plane that carries the objects; that plane was found without it"
)


def _check_beside(
    observation: RgbdObservation,
    detections: Sequence[Detection],
    normal: Array,
    offset: float,
) -> None:
    """Raises `NoSurfaceError` if nearly all of a plane lies on the objects."""
    depth = observation.depth.astype(float)
    heights = observation.intrinsics.unproject(depth) @ normal + offset
    on_plane = (depth > 0) & (np.abs(heights) < 2 * depth_tolerance(depth) + 0.001)
    inside = np.logical_or.reduce([d.pixels(*depth.shape) for d in detections])
    if (on_plane & ~inside).sum() < _LEAST_BESIDE * on_plane.sum():
        raise NoSurfaceError(
            "support surface",
            "no plane found under the objects, only planes on them",
            "give its height (--surface Z) or images that show more of it",
        )


def _cloud_near(
    observation: RgbdObservation,
    detections: Sequence[Detection],
    reach: float,
    factor: float,
) -> tuple[Array, Array]:
    """Points (N, 3) in C around the detections, and those in them; all, and none."""
    shape = observation.depth.shape
    valid = (observation.depth > 0) & (observation.depth < reach)
    near, inside = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
    for detection in detections:
        left, top, right, bottom = detection.box
        grow = 0.6 * max(right - left, bottom - top)
        rows = slice(max(int(top - grow), 0), max(int(bottom + grow), 0))
        columns = slice(max(int(left - grow), 0), max(int(right + grow), 0))
        near[rows, columns] = True
        inside |= _foreground(detection, observation.depth, valid, factor)
    cloud = observation.intrinsics.unproject(observation.depth)
    return cloud[valid & (near if detections else True)], cloud[valid & inside]


def _foreground(
    detection: Detection, depth: DepthImage, valid: Mask, factor: float
) -> Mask:
    """The measured pixels of a detection, less what a box shows behind its object.

    Beside the object a box may show the floor beyond the table's edge.
    """
    pixels = detection.pixels(*depth.shape) & valid
    if detection.mask is not None or not pixels.any():
        return pixels
    return np.asarray(pixels & (depth < np.median(depth[pixels]) + _BEHIND * factor))


def _thinned(
    points: Array, count: int, factor: float, generator: np.random.Generator
) -> Array:
    """One point a voxel, and at most `count` of them."""
    thinned = first_in_voxels(points, _VOXEL * factor)
    if len(thinned) <= count:
        return thinned
    return np.asarray(thinned[generator.choice(len(thinned), count, replace=False)])


def _surface_from_plane(
    normal_C: Array, camera_height: float, X_WC: Array | None
) -> SupportSurface:
    along_axis = camera_height / max(-normal_C[2], 1e-3)
    x_axis = np.array([1.0, 0.0, 0.0])
    x_axis = x_axis - normal_C * (x_axis @ normal_C)
    x_axis /= np.linalg.norm(x_axis)
    R_CS = np.stack([x_axis, np.cross(normal_C, x_axis), normal_C], axis=1)
    # On the optical axis where it meets the plane, else below the camera.
    p_CS = (
        np.array([0.0, 0.0, along_axis])
        if along_axis < _MAX_RANGE
        else -camera_height * normal_C
    )
    X_CS = make_pose(R_CS, p_CS)
    return SupportSurface(X_CS, np.eye(4) if X_WC is None else X_WC @ X_CS)


def heights_above(surface: SupportSurface, p_C: Array) -> Array:
    """Heights (...,) in metres of points (..., 3) in C above the surface."""
    flat = transform_points(surface.X_SC, p_C.reshape(-1, 3))
    return np.asarray(flat[:, 2].reshape(p_C.shape[:-1]))
