# SPDX-License-Identifier: MIT
"""Estimates poses for other processes: images come in by LCM, poses go out by LCM.

    python examples/lcm_bridge.py MODELS DETECTIONS.json

Listens on the channel PHYSIM_IMAGES for lcmt_image_array messages with a depth image
(uint16 in mm or float32 in m) and a colour image of the same size, as Drake's
`ImageToLcmImageArrayT` sends them. Publishes lcmt_viewer_draw messages on the channel
PHYSIM_POSES: names, positions and quaternions in the camera. A ROS 2 node looks the
same: its callback calls `estimate` on the arrays of the two image messages.

DETECTIONS.json maps object names to boxes: {"crayola_24_ct": [287, 133, 395, 192]}.
"""

from __future__ import annotations

import json
import sys
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from drake import lcmt_image, lcmt_image_array, lcmt_viewer_draw
from numpy.typing import NDArray
from pydrake.lcm import DrakeLcm, DrakeLcmInterface
from pydrake.math import RigidTransform

import physim_drake as physim

IMAGES, POSES = "PHYSIM_IMAGES", "PHYSIM_POSES"
TYPES = {
    lcmt_image.CHANNEL_TYPE_UINT8: np.uint8,
    lcmt_image.CHANNEL_TYPE_UINT16: np.uint16,
    lcmt_image.CHANNEL_TYPE_FLOAT32: np.float32,
}


def decode(image: lcmt_image) -> NDArray[np.generic]:
    """The pixels of an LCM image, (height, width) or (height, width, channels)."""
    data = bytes(image.data)
    if image.compression_method == lcmt_image.COMPRESSION_METHOD_ZLIB:
        data = zlib.decompress(data)
    elif image.compression_method != lcmt_image.COMPRESSION_METHOD_NOT_COMPRESSED:
        raise physim.InputError(IMAGES, "is JPEG or PNG", "send zlib or plain pixels")
    pixels = np.frombuffer(data, TYPES[image.channel_type])
    return pixels.reshape(image.height, image.width, -1).squeeze()


def receive(message: lcmt_image_array, focal_length: float) -> physim.RgbdObservation:
    """The observation in a message, by a camera whose axis meets the middle."""
    images = {image.pixel_format: decode(image) for image in message.images}
    depth = images[lcmt_image.PIXEL_FORMAT_DEPTH]
    if depth.dtype == np.uint16:
        depth = depth.astype(np.float32) * 0.001
    color = images.get(
        lcmt_image.PIXEL_FORMAT_RGB, images.get(lcmt_image.PIXEL_FORMAT_RGBA)
    )
    height, width = depth.shape
    camera = physim.CameraIntrinsics(
        *(width, height, focal_length, focal_length),
        *(width / 2 - 0.5, height / 2 - 0.5),
    )
    return physim.RgbdObservation(
        np.asarray(depth, dtype=np.float32),
        camera,
        None if color is None else np.asarray(color[..., :3], dtype=np.uint8),
    )


def poses_message(
    found: Sequence[physim.ObjectEstimate], utime: int
) -> lcmt_viewer_draw:
    """The found poses as a message."""
    message = lcmt_viewer_draw()
    message.timestamp, message.num_links = utime, len(found)
    for item in found:
        X_CO = RigidTransform(item.X_CO)
        message.link_name.append(item.name)
        message.robot_num.append(item.object_id)
        message.position.append(X_CO.translation().tolist())
        message.quaternion.append(X_CO.rotation().ToQuaternion().wxyz().tolist())
    return message


def answer(
    message: lcmt_image_array,
    estimator: physim.PoseEstimator,
    detections: Sequence[physim.Detection],
    focal_length: float = 615.0,
) -> lcmt_viewer_draw:
    """The poses in a message with images.

    Args:
        message: depth image, with or without a colour image.
        estimator: estimator that knows the objects.
        detections: one for each object to find.
        focal_length: focal length of the camera, pixels.
    """
    observation = receive(message, focal_length)
    estimate = estimator.estimate(observation, detections)
    return poses_message(estimate.found, message.header.utime)


def run(
    lcm: DrakeLcmInterface,
    library: physim.ObjectLibrary,
    boxes: Mapping[str, Sequence[float]],
) -> None:
    """Answers each message with images, until the program is stopped."""
    detections = [
        physim.Detection(library.by_name(name).object_id, box)
        for name, box in boxes.items()
    ]
    received: list[bytes] = []
    lcm.Subscribe(IMAGES, received.append)
    with physim.PoseEstimator(library) as estimator:
        while True:
            lcm.HandleSubscriptions(100)
            if received:  # the newest; what came during the last estimate is old
                message = lcmt_image_array.decode(received[-1])
                received.clear()
                lcm.Publish(POSES, answer(message, estimator, detections).encode())


if __name__ == "__main__":
    models, detections = sys.argv[1:]
    run(
        DrakeLcm(),
        physim.ObjectLibrary.load(models),
        json.loads(Path(detections).read_text()),
    )
