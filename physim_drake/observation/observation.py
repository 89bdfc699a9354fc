# SPDX-License-Identifier: MIT
"""What one look at a scene gives: the images, the detections and their segments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physim_drake.camera import CameraIntrinsics, DepthImage
from physim_drake.errors import InputError
from physim_drake.notebook import image_html
from physim_drake.poses import Array, is_rotation

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class RgbdObservation:
    """One RGB-D image and its camera.

    Attributes:
        depth: z in C, m, (height, width) float32, 0 where nothing was measured. You
            may give any floating type, and also NaN or infinity instead of 0.
        intrinsics: camera of the depth image, to which colour is registered. You may
            give `CameraIntrinsics` or its (3, 3) matrix.
        color: RGB image, (height, width, 3) uint8, or None.
        X_WC: camera pose in the world, (4, 4), or None if it is unknown.
        name: name in messages, for instance that of its file.

    Raises:
        InputError: if shapes, values or the rotation cannot be right.
    """

    depth: DepthImage
    intrinsics: CameraIntrinsics
    color: NDArray[np.uint8] | None = None
    X_WC: Array | None = None
    name: str = "observation"

    def __post_init__(self) -> None:
        object.__setattr__(self, "depth", _as_depth(self.depth))
        if isinstance(self.intrinsics, np.ndarray) and self.depth.ndim == 2:
            height, width = self.depth.shape
            camera = CameraIntrinsics.from_matrix(self.intrinsics, width, height)
            object.__setattr__(self, "intrinsics", camera)
        self._check_depth()
        self._check_pose()
        shape = self.depth.shape
        if self.color is not None and self.color.shape != (*shape, 3):
            raise InputError(
                self.name,
                f"has shape {self.color.shape}, depth {shape}",
                "register colour to depth at the same size",
                "color",
            )
        fits = (
            self.intrinsics.fx > 0
            and self.intrinsics.fy > 0
            and -0.5 * shape[1] < self.intrinsics.cx < 1.5 * shape[1]
            and -0.5 * shape[0] < self.intrinsics.cy < 1.5 * shape[0]
        )
        if not fits:
            raise InputError(
                self.name,
                f"{self.intrinsics} do not fit an image of {shape[1]} x {shape[0]}",
                "give fx, fy, cx, cy in pixels of this image",
                "intrinsics",
            )

    def __repr__(self) -> str:
        camera, color = self.intrinsics, "no " if self.color is None else ""
        return f"<{self.name}: {camera.width} x {camera.height}, {color}colour>"

    def _repr_html_(self) -> str:
        far = float(np.percentile(self.depth[self.depth > 0], 99))
        grey = np.clip(self.depth / far * 255, 0, 255).astype(np.uint8)
        depth = np.repeat(grey[..., None], 3, axis=2)
        both = depth if self.color is None else np.hstack([self.color, depth])
        return image_html(both, f"colour and depth of {self.name}")

    def need_color(self) -> NDArray[np.uint8]:
        """The colour image, (height, width, 3) RGB, by which objects are detected.

        Raises:
            InputError: if the image has no colour.
        """
        if self.color is None:
            raise InputError(
                self.name,
                "has no colour, by which objects are detected",
                "give colour images, or detections",
            )
        return self.color

    def _check_depth(self) -> None:
        shape = (self.intrinsics.height, self.intrinsics.width)
        if self.depth.ndim != 2 or self.depth.dtype != np.float32:
            raise InputError(
                self.name,
                f"is {self.depth.dtype} of shape {self.depth.shape}",
                "give a (height, width) image in metres; multiply whole numbers by "
                "metres per unit, as in depth * 0.001",
                "depth",
            )
        if self.depth.shape != shape:
            raise InputError(
                self.name,
                f"has {self.depth.shape} pixels, the intrinsics {shape}",
                "give the intrinsics of this image size",
                "depth",
            )
        if (self.depth < 0).any():
            raise InputError(
                self.name,
                "holds negative values",
                "write 0 where nothing was measured",
                "depth",
            )
        if not self.depth.any():
            raise InputError(
                self.name,
                "is zero everywhere",
                "check the depth file and depth_scale",
                "depth",
            )

    def _check_pose(self) -> None:
        if self.X_WC is not None and self.X_WC.shape != (4, 4):
            raise InputError(
                self.name, f"has shape {self.X_WC.shape}", "give a 4 x 4 pose", "X_WC"
            )
        if self.X_WC is not None and not (
            np.isfinite(self.X_WC).all() and is_rotation(self.X_WC[:3, :3])
        ):
            raise InputError(
                self.name,
                "rotation is not orthonormal and right-handed",
                "give a rotation matrix, rows first",
                "X_WC",
            )


def _as_depth(depth: NDArray[Any]) -> DepthImage:
    """Depth of any floating type as float32, 0 where nothing was measured."""
    depth = np.asarray(depth)
    if not np.issubdtype(depth.dtype, np.floating):
        return depth
    depth = depth.astype(np.float32, copy=False)
    measured = np.isfinite(depth)
    return depth if measured.all() else np.where(measured, depth, np.float32(0))


@dataclass(frozen=True, init=False)
class Detection:
    """An object's place in an image, as a detector gives it.

    Attributes:
        object_id: id of the object.
        box: left, top, right, bottom in pixels (right and bottom exclusive), (4,). You
            may give an array or a list.
        score: the detector's confidence, 0..1.
        mask: mask, (height, width) bool, if the detector gives one, else None.
        instead: other places where it sees the object, the likeliest first; see
            `physim_drake.observation.detection_alternatives`.
    """

    object_id: int
    box: Array
    score: float = 1.0
    mask: Mask | None = None
    instead: tuple[Detection, ...] = ()

    def __init__(
        self,
        object_id: int,
        box: Array | Sequence[float],
        score: float = 1.0,
        mask: Mask | None = None,
        instead: tuple[Detection, ...] = (),
    ) -> None:
        corners = np.asarray(box, dtype=float)
        if corners.shape != (4,) or not np.isfinite(corners).all():
            raise InputError(
                f"detection of object {object_id}",
                f"is {box!r}",
                "give left, top, right, bottom in pixels",
                "box",
            )
        if corners[2] < corners[0] or corners[3] < corners[1]:
            raise InputError(
                f"detection of object {object_id}",
                f"is {corners.tolist()}, whose right or bottom lies before its left or "
                "top",
                "give left, top, right, bottom; of x, y, width, height that is "
                "x, y, x + width, y + height",
                "box",
            )
        values = (object_id, corners, score, mask, instead)
        for field, value in zip(fields(self), values, strict=True):
            object.__setattr__(self, field.name, value)

    @classmethod
    def unseen(cls, object_id: int, height: int, width: int) -> Detection:
        """Says that a detector did not see an object, in an image of this size."""
        mask = np.zeros((height, width), dtype=bool)
        return cls(object_id, np.zeros(4), 0.0, mask)

    @property
    def seen(self) -> bool:
        """Whether the detector saw the object; if not, its mask has no pixel."""
        return self.mask is None or bool(self.mask.any())

    def pixels(self, height: int, width: int) -> Mask:
        """The pixels that may show the object, (height, width) bool."""
        if self.mask is not None:
            return self.mask
        left, top, right, bottom = self.box
        rows, columns = np.arange(height), np.arange(width)
        inside = (rows >= top) & (rows < bottom)
        return np.asarray(inside[:, None] & ((columns >= left) & (columns < right)))


@dataclass(frozen=True)
class Segment:
    """The part of the observed cloud that may belong to one object.

    Attributes:
        detection: detection that it was cut out by.
        points: p_S (N, 3), m, in the support frame S, thinned to a few millimetres.
        normals: unit, (N, 3), in S, towards the camera.
        mask: (height, width) bool, every pixel of it, before thinning.
    """

    detection: Detection
    points: Array
    normals: Array
    mask: Mask

    @property
    def object_id(self) -> int:
        """Which object it may belong to."""
        return self.detection.object_id
