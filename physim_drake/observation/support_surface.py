# SPDX-License-Identifier: MIT
"""The support surface: the plane the objects rest on, whose normal is gravity's.

The calibrated vertical may be degrees off; the plane in the cloud is not (in the
original authors' scene the two differ by 3.6 degrees). It is found by RANSAC among
planes that have the objects not far above them and nothing below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physim_drake.camera import DepthImage
from physim_drake.errors import InputError
from physim_drake.observation.observation import Detection, Mask, RgbdObservation
from physim_drake.observation.voxels import first_in_voxels
from physim_drake.poses import Array, inverse, make_pose, transform_points

_ITERATIONS = 1500
_VOXEL = 0.01
_MAX_RANGE = 3.0
_MAX_TILT = np.radians(30.0)
_MAX_BELOW = 0.1  # of the detections' points
_OBJECT_HEIGHT = 0.3  # m; planes that the objects are farther above count for less
_MIN_SUPPORT = 50
_BEHIND = 0.1  # m; what lies farther behind the middle of a box is not its object


@dataclass(frozen=True)
class SupportSurface:
    """The plane z = 0 of the support frame S.

    Attributes:
        X_CS: pose of S in the camera, (4, 4): origin where the optical axis meets the
            plane, z along its normal towards the camera, x near the camera's x.
        X_WS: the same in the world; the identity where no camera pose is known.
    """

    X_CS: Array
    X_WS: Array

    @property
    def X_SC(self) -> Array:
        """The camera's pose in S, (4, 4)."""
        return inverse(self.X_CS)


def depth_tolerance(z: Array) -> Array:
    """A cautious standard deviation (m) of a depth camera's reading at `z` (m).

    Twice the quadratic law of structured-light and stereo cameras of the RealSense
    class at half a metre.
    """
    return np.asarray(0.0005 + 0.002 * np.square(z))


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


def find_support_surface(
    observation: RgbdObservation,
    detections: Sequence[Detection] = (),
    generator: np.random.Generator | None = None,
) -> SupportSurface:
    """Finds the plane that carries the detected objects.

    Args:
        observation: the image; with a camera pose only planes within 30 degrees of
            the horizontal count.
        detections: where objects are; the cloud around them decides. Without any, the
            dominant plane of the image is taken.
        generator: for the random samples.

    Raises:
        InputError: where no plane has enough points.
    """
    generator = np.random.default_rng(0) if generator is None else generator
    cloud, objects = _cloud_near(observation, detections)
    points = _thinned(cloud, 4000, generator)
    if len(points) < 100:
        measured = observation.depth[observation.depth > 0]
        far = f"{np.median(measured):.3g} m" if len(measured) else "nothing"
        raise InputError(
            observation.name,
            f"only {len(points)} depth points near the objects that are less than "
            f"{_MAX_RANGE:g} m away; the whole image shows {far} (median)",
            "check the detections, the depth image and its unit (depth_scale)",
            "surface",
        )
    up_C = None if observation.X_WC is None else observation.X_WC[:3, :3].T[:, 2]
    normal, offset = _ransac(
        points, _thinned(objects, 1000, generator), up_C, generator
    )
    for scale in (3.0, 2.0, 2.0):
        heights = cloud @ normal + offset
        inliers = np.abs(heights) < scale * depth_tolerance(cloud[:, 2]) + 0.001
        normal, offset = _fit(cloud[inliers], 1 / depth_tolerance(cloud[inliers, 2]))
    return _surface_from_plane(normal, offset, observation.X_WC)


def _cloud_near(
    observation: RgbdObservation, detections: Sequence[Detection]
) -> tuple[Array, Array]:
    """Points (N, 3) in C around the detections, and those in them; all, and none."""
    shape = observation.depth.shape
    valid = (observation.depth > 0) & (observation.depth < _MAX_RANGE)
    near, inside = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
    for detection in detections:
        left, top, right, bottom = detection.box
        grow = 0.6 * max(right - left, bottom - top)
        rows = slice(max(int(top - grow), 0), max(int(bottom + grow), 0))
        columns = slice(max(int(left - grow), 0), max(int(right + grow), 0))
        near[rows, columns] = True
        inside |= _foreground(detection, observation.depth, valid)
    cloud = observation.intrinsics.unproject(observation.depth)
    return cloud[valid & (near if detections else True)], cloud[valid & inside]


def _foreground(detection: Detection, depth: DepthImage, valid: Mask) -> Mask:
    """The measured pixels of a detection, less what a box shows behind its object.

    Beside the object a box may show the floor beyond the table's edge.
    """
    pixels = detection.pixels(*depth.shape) & valid
    if detection.mask is not None or not pixels.any():
        return pixels
    return np.asarray(pixels & (depth < np.median(depth[pixels]) + _BEHIND))


def _thinned(points: Array, count: int, generator: np.random.Generator) -> Array:
    """One point a voxel, and at most `count` of them."""
    thinned = first_in_voxels(points, _VOXEL)
    if len(thinned) <= count:
        return thinned
    return np.asarray(thinned[generator.choice(len(thinned), count, replace=False)])


def _ransac(
    points: Array,
    objects: Array,
    up_C: Array | None,
    generator: np.random.Generator,
) -> tuple[Array, float]:
    """The plane (unit normal, offset) with most points on it and no objects below."""
    triples = points[generator.integers(len(points), size=(_ITERATIONS, 3))]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    good = lengths > 1e-5
    normals, triples = normals[good] / lengths[good, None], triples[good]
    # The camera looks at the surface from above: its origin has a positive height.
    offsets = -np.einsum("ni,ni->n", normals, triples[:, 0])
    flip = np.where(offsets < 0, -1.0, 1.0)
    normals, offsets = normals * flip[:, None], offsets * flip
    if up_C is not None:
        upright = normals @ up_C > np.cos(_MAX_TILT)
        normals, offsets = normals[upright], offsets[upright]
    band = 3 * depth_tolerance(points[:, 2])[:, None]
    support = (np.abs(points @ normals.T + offsets) < band).sum(axis=0)
    score = support.astype(float)
    if len(objects):
        band = 10 * depth_tolerance(objects[:, 2])[:, None]
        heights = objects @ normals.T + offsets
        score *= (heights < -band).mean(axis=0) < _MAX_BELOW
        # A wall or the floor may have nothing below it either, but is far away.
        score /= 1 + np.square(np.median(heights, axis=0) / _OBJECT_HEIGHT)
    score *= support >= _MIN_SUPPORT
    if len(normals) == 0 or score.max() == 0:
        raise InputError(
            "support surface",
            "no plane found under the objects",
            "give its height (--surface Z) or images that show more of it",
        )
    best = int(score.argmax())
    return normals[best], float(offsets[best])


def _fit(points: Array, weights: Array) -> tuple[Array, float]:
    """Weighted least-squares plane through points (N, 3): unit normal, offset."""
    centre = np.average(points, axis=0, weights=weights)
    centred = (points - centre) * weights[:, None]
    normal = np.linalg.eigh(centred.T @ centred)[1][:, 0]
    offset = -float(normal @ centre)
    return (normal, offset) if offset > 0 else (-normal, -offset)


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
