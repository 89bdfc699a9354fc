# SPDX-License-Identifier: MIT
"""The files of one BOP scene: cameras, ground truth, image paths."""

from __future__ import annotations

import logging
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from physim_drake.camera import CameraIntrinsics
from physim_drake.errors import InputError
from physim_drake.poses import Array, inverse, is_rotation, make_pose, nearest_rotation
from physim_drake.storage.json_nodes import JsonNode, read_json

_COLOR_NAMES = ("rgb/{:06d}.png", "rgb/{:06d}.jpg", "gray/{:06d}.png")
MAX_TRANSLATION_MM = 1e6
"""Longest translation: longer ones are not in mm, or not of a scene on a table."""

_SKEW_OF_ROUNDING = 1e-6
"""Share of fx: calibration programs write skews of 1e-13 for 0."""
_ROUNDED_ROTATION = 1e-2
"""Largest error of R R^T: the true poses of LM-O are off by 2e-3."""

_log = logging.getLogger(__name__)


class SceneFiles:
    """The files of one scene; each JSON file is parsed once, when it is needed.

    Args:
        folder: folder of the scene.

    Attributes:
        folder: folder of the scene.
        camera_path: path of its scene_camera.json.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.camera_path = folder / "scene_camera.json"

    @cached_property
    def cameras(self) -> dict[int, JsonNode]:
        """Members of scene_camera.json by image id."""
        return read_json(self.camera_path).by_id()

    @cached_property
    def ground_truth(self) -> dict[int, JsonNode]:
        """Members of scene_gt.json by image id; empty without the file."""
        return self._optional("scene_gt.json")

    @cached_property
    def ground_truth_info(self) -> dict[int, JsonNode]:
        """Members of scene_gt_info.json by image id; empty without the file."""
        return self._optional("scene_gt_info.json")

    def camera(self, im_id: int) -> JsonNode:
        """The camera of an image; raises `InputError` if it is not listed."""
        if im_id not in self.cameras:
            raise InputError(
                self.camera_path, f"has no image {im_id}", "choose one that it lists"
            )
        return self.cameras[im_id]

    def depth_path(self, im_id: int) -> Path:
        """Path of the depth image."""
        return self.folder / "depth" / f"{im_id:06d}.png"

    def color_path(self, im_id: int) -> Path | None:
        """Path of the colour or grey image; None if the scene has neither folder.

        If a folder lacks the image, its path is returned, so that reading it fails.
        """
        paths = [self.folder / name.format(im_id) for name in _COLOR_NAMES]
        kept = [path for path in paths if path.exists()]
        expected = [path for path in paths if path.parent.is_dir()]
        return next(iter([*kept, *expected]), None)

    def _optional(self, name: str) -> dict[int, JsonNode]:
        path = self.folder / name
        return read_json(path).by_id() if path.exists() else {}


def read_intrinsics(camera: JsonNode, width: int, height: int) -> CameraIntrinsics:
    """The camera of `width` x `height` pixels with the cam_K of its entry."""
    node = camera["cam_K"]
    K = node.array(3, 3)
    if abs(K[0, 1]) <= _SKEW_OF_ROUNDING * abs(K[0, 0]):
        K[0, 1] = 0.0
    if np.any(K[[0, 1, 2, 2, 2], [1, 0, 0, 1, 2]] != [0, 0, 0, 0, 1]):
        node.fail("has skew or lacks [0, 0, 1]", "give fx, 0, cx, 0, fy, cy, 0, 0, 1")
    return CameraIntrinsics.from_matrix(K, width, height)


def read_camera_pose(camera: JsonNode) -> Array | None:
    """X_WC, m; None if the dataset does not give it."""
    if camera.get("cam_R_w2c") is None and camera.get("cam_t_w2c") is None:
        return None
    return inverse(read_pose(camera, "cam_R_w2c", "cam_t_w2c"))


def read_pose(node: JsonNode, rotation: str, translation: str) -> Array:
    """The pose (4, 4), m, of BOP's R and t in mm."""
    R = node[rotation].array(3, 3)
    if not is_rotation(R, _ROUNDED_ROTATION):
        node[rotation].fail(
            "is not a rotation",
            "give 9 numbers, rows first, of a right-handed rotation",
        )
    if not is_rotation(R):
        _tell_of_rounding(str(node.source))
    t_mm = node[translation].array(3)
    if np.abs(t_mm).max() > MAX_TRANSLATION_MM:
        node[translation].fail(
            f"is {np.abs(t_mm).max():g} mm long", "translations are in millimetres"
        )
    return make_pose(nearest_rotation(R), t_mm * 1e-3)


@cache
def _tell_of_rounding(source: str) -> None:
    """Says once for each file that its rotations were corrected."""
    _log.warning(
        "%s: holds rotations that are not quite orthonormal; the nearest rotations "
        "are used",
        source,
    )
