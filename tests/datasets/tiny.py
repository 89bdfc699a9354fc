# SPDX-License-Identifier: MIT
"""A BOP dataset of two small images, and bytes with defects."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from hypothesis import strategies as st

WIDTH, HEIGHT = 12, 8
ROTATION = [0, -1, 0, 1, 0, 0, 0, 0, 1]
CAMERA = {
    "cam_K": [10.0, 0, 5.5, 0, 11.0, 3.5, 0, 0, 1],
    "depth_scale": 0.1,
    "cam_R_w2c": ROTATION,
    "cam_t_w2c": [0.0, 0.0, 500.0],
}


def write_json(path: Path, value: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value))


def write_image(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def depth_image() -> np.ndarray:
    return np.arange(WIDTH * HEIGHT, dtype=np.uint16).reshape(HEIGHT, WIDTH) + 5000


def mask_image(left: int, right: int) -> np.ndarray:
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[2:5, left:right] = 255
    return mask


def write_tiny(root: Path) -> Path:
    """Writes scene 3 with images 0 and 7, objects 1 and 2 in both."""
    scene = root / "test" / "000003"
    poses = [
        {"obj_id": 1, "cam_R_m2c": ROTATION, "cam_t_m2c": [10.0, 20.0, 510.0]},
        {"obj_id": 2, "cam_R_m2c": ROTATION, "cam_t_m2c": [-10.0, 0.0, 505.0]},
    ]
    info = [{"visib_fract": 1.0}, {"visib_fract": 0.5}]
    color = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    color[..., 0] = 200  # blue, as OpenCV writes it
    for im_id in (0, 7):
        write_image(scene / "depth" / f"{im_id:06d}.png", depth_image())
        write_image(scene / "rgb" / f"{im_id:06d}.png", color)
        for index, bounds in enumerate([(1, 4), (6, 10)]):
            name = f"{im_id:06d}_{index:06d}.png"
            write_image(scene / "mask_visib" / name, mask_image(*bounds))
    write_json(scene / "scene_camera.json", {"0": CAMERA, "7": CAMERA})
    write_json(scene / "scene_gt.json", {"0": poses, "7": poses})
    write_json(scene / "scene_gt_info.json", {"0": info, "7": info})
    targets = [
        {"scene_id": 3, "im_id": im_id, "obj_id": object_id, "inst_count": 1}
        for im_id in (0, 7)
        for object_id in (1, 2)
    ]
    write_json(root / "test_targets_bop19.json", targets)
    levels = {"0": 1, "1": 2}
    write_json(root / "levels.json", {"3": {"0": levels, "7": levels}})
    return root


def detection(**changes: Any) -> dict[str, Any]:
    """An entry of a detections file."""
    entry = {
        "scene_id": 3,
        "image_id": 0,
        "category_id": 1,
        "bbox": [1.0, 2.0, 3.0, 3.0],
        "score": 0.5,
    }
    return entry | changes


@st.composite
def mangled(draw: st.DrawFn, data: bytes) -> bytes:
    """`data` with some bytes changed, inserted or removed, or cut short."""
    result = bytearray(data)
    for _ in range(draw(st.integers(1, 4))):
        place = draw(st.integers(0, max(0, len(result) - 1)))
        removed = draw(st.integers(0, 3))
        result[place : place + removed] = draw(
            st.binary(max_size=3)
            | st.sampled_from(
                [b"-", b"9" * 30, b"null", b"[", b"}", b'"', b"e", b"1e999"]
            )
        )
    if draw(st.booleans()):
        del result[draw(st.integers(0, len(result))) :]
    return bytes(result)
