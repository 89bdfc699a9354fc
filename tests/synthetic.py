# SPDX-License-Identifier: MIT
"""Synthetic observations of the APC objects on a table, with ground truth.

World frame: z up, the table is z = 0, as large as the image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from physim_drake.camera import CameraIntrinsics, DepthImage
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary, ObjectModel
from physim_drake.observation.observation import Detection, Mask, RgbdObservation
from physim_drake.observation.segmented_scene import SegmentedScene, prepare_scene
from physim_drake.observation.support_surface import (
    SupportSurface,
    depth_tolerance,
    surface_at_height,
)
from physim_drake.poses import Array, SymmetryGroup, inverse, make_pose
from physim_drake.rendering.depth import DepthRenderer
from physim_drake.search.states import composite

CAMERA = CameraIntrinsics(320, 240, 300.0, 300.0, 159.5, 119.5)
ERASER, COFFEE, TAPE, BOOK, TISSUES, SOAP, GLUE, BALL = 2, 3, 4, 6, 8, 9, 10, 11

Objects = Sequence[tuple[int, Array]]
"""(object id, X_WO) of each object."""


@cache
def library() -> ObjectLibrary:
    """The objects named above."""
    return ObjectLibrary.load(
        APC11, [ERASER, COFFEE, TAPE, BOOK, TISSUES, SOAP, GLUE, BALL]
    )


@cache
def renderer(intrinsics: CameraIntrinsics = CAMERA) -> DepthRenderer:
    return DepthRenderer(library(), intrinsics)


def look_at(position: Sequence[float], target: Sequence[float]) -> Array:
    """X_WC of a camera at `position` that looks at `target`, its x horizontal."""
    p, forward = np.array(position), np.subtract(target, position)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return make_pose(np.stack([right, np.cross(forward, right), forward], axis=1), p)


X_WC = look_at([0.05, -0.45, 0.55], [0.0, 0.0, 0.04])


def turned(sequence: str, *degrees: float) -> Array:
    """A rotation matrix from Euler angles about the axes of W."""
    return np.asarray(Rotation.from_euler(sequence, degrees, degrees=True).as_matrix())


def resting(object_id: int, R: Array, x: float, y: float, z: float = 0.0) -> Array:
    """X_WO of an object so turned whose lowest point is at height z."""
    points = library()[object_id].mesh.vertices @ R.T
    return make_pose(R, [x, y, z - points[:, 2].min()])


def stack() -> Objects:
    """A bar of soap, lying, on the eraser, lying."""
    lower = resting(ERASER, turned("z", 20), 0.0, 0.0)
    height = float(library()[ERASER].extents[2])
    return (
        (ERASER, lower),
        (SOAP, resting(SOAP, turned("yz", 90, 60), 0.005, 0.01, height)),
    )


def pair_apart() -> Objects:
    """Two objects that have nothing to do with each other."""
    return (
        (GLUE, resting(GLUE, turned("z", 30), -0.08, 0.0)),
        (SOAP, resting(SOAP, turned("yz", 90, 60), 0.08, 0.02)),
    )


@dataclass(frozen=True)
class SyntheticScene:
    """An observation, and what is true of it.

    Attributes:
        observation: the image.
        detections: boxes of the visible pixels, one an object.
        X_WO: the true poses, in the world.
        masks: the visible pixels of each object.
        surface: the table.
        ideal_depth: the depth image without noise.
    """

    observation: RgbdObservation
    detections: tuple[Detection, ...]
    X_WO: tuple[Array, ...]
    masks: tuple[Mask, ...]
    surface: SupportSurface
    ideal_depth: DepthImage

    @property
    def X_SO(self) -> tuple[Array, ...]:
        """The true poses, in the support frame."""
        return tuple(inverse(self.surface.X_WS) @ X for X in self.X_WO)

    def scene(self) -> SegmentedScene:
        """Prepared for estimation with the true surface."""
        return prepare_scene(self.observation, self.surface, self.detections)


def plane_depth(
    intrinsics: CameraIntrinsics, X_WC: Array, normal: Sequence[float], offset: float
) -> DepthImage:
    """Depth of the plane normal . p_W = offset, m, 0 where no ray meets it."""
    n = np.array(normal)
    along = intrinsics.rays() @ (X_WC[:3, :3].T @ n)
    with np.errstate(divide="ignore"):
        z = (offset - n @ X_WC[:3, 3]) / along
    return np.where((z > 0) & (z < 10), z, 0).astype(np.float32)


def noisy(depth: DepthImage, scale: float, seed: int) -> DepthImage:
    """The depth image with Gaussian noise of `scale` times the model's deviation."""
    generator = np.random.default_rng(seed)
    deviation = scale * depth_tolerance(depth.astype(float))
    noise = deviation * generator.normal(size=depth.shape)
    return np.where(depth > 0, depth + noise, 0).astype(np.float32)


def synthesize(
    objects: Objects,
    noise: float = 0.5,
    seed: int = 0,
    X_WC: Array = X_WC,
    intrinsics: CameraIntrinsics = CAMERA,
    table: DepthImage | None = None,
) -> SyntheticScene:
    """Renders objects on a table.

    Args:
        objects: what to draw.
        noise: of the depth, in units of `depth_tolerance`.
        seed: of the noise.
        X_WC: the camera's pose.
        intrinsics: of the camera.
        table: depth image of what is behind the objects; the plane z = 0 if None.
    """
    if table is None:
        table = plane_depth(intrinsics, X_WC, [0.0, 0.0, 1.0], 0.0)
    images = [
        renderer(intrinsics).render(i, inverse(X_WC) @ X_WO) for i, X_WO in objects
    ]
    depth = table
    for image in images:
        depth = composite(depth, image)
    masks = tuple((image > 0) & (image == depth) for image in images)
    observation = RgbdObservation(noisy(depth, noise, seed), intrinsics, None, X_WC)
    return SyntheticScene(
        observation,
        tuple(
            Detection(i, mask_box(m)) for (i, _), m in zip(objects, masks, strict=True)
        ),
        tuple(X for _, X in objects),
        masks,
        surface_at_height(observation, 0.0),
        depth,
    )


def mask_box(mask: Mask) -> Array:
    """Left, top, right, bottom of the pixels of a mask."""
    rows, columns = np.nonzero(mask)
    return np.array(
        [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1], dtype=float
    )


def pose_error(X: Array, X_true: Array, symmetry: SymmetryGroup) -> tuple[float, float]:
    """Distance of the origins in mm, and smallest angle to an equivalent in degrees."""
    shift = float(np.linalg.norm(X[:3, 3] - X_true[:3, 3]))
    turn = float(symmetry.rotation_distance(X[:3, :3], X_true[:3, :3])[0])
    return 1e3 * shift, np.degrees(turn)


def perturbed(X: Array, shift: float, angle: float, seed: int) -> Array:
    """The pose moved by `shift` (m) and turned by `angle` (rad) in random ways."""
    v, w = np.random.default_rng(seed).normal(size=(2, 3))
    moved = X.copy()
    turn = Rotation.from_rotvec(angle * w / np.linalg.norm(w)).as_matrix()
    moved[:3, :3] = turn @ X[:3, :3]
    moved[:3, 3] += shift * v / np.linalg.norm(v)
    return moved


@cache
def l_shape() -> ObjectModel:
    """A shape without any symmetry, 10 x 7 x 6 cm."""
    mesh = trimesh.boolean.union(
        [
            trimesh.creation.box(bounds=[[0, 0, 0], [0.10, 0.03, 0.04]]),
            trimesh.creation.box(bounds=[[0, 0.01, 0], [0.03, 0.07, 0.06]]),
        ]
    )
    return ObjectModel.from_mesh(1, "l_shape", mesh, symmetry=SymmetryGroup())
