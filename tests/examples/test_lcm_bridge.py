# SPDX-License-Identifier: MIT
from __future__ import annotations

import zlib

import numpy as np
import pytest
from drake import lcmt_image, lcmt_image_array, lcmt_viewer_draw
from numpy.typing import NDArray

import physim_drake as physim
from tests.examples.test_examples import FOLDER, load

BOX = [158, 177, 252, 337]  # of the bottle


def as_message(pixels: NDArray[np.generic], pixel_format: int) -> lcmt_image:
    image = lcmt_image()
    image.height, image.width = pixels.shape[:2]
    image.pixel_format = pixel_format
    image.channel_type = {
        np.dtype(np.uint8): lcmt_image.CHANNEL_TYPE_UINT8,
        np.dtype(np.uint16): lcmt_image.CHANNEL_TYPE_UINT16,
    }[pixels.dtype]
    image.compression_method = lcmt_image.COMPRESSION_METHOD_ZLIB
    image.data = zlib.compress(pixels.tobytes())
    image.size = len(image.data)
    return image


def test_images_come_in_and_poses_go_out() -> None:
    bridge = load("lcm_bridge")
    observation = physim.BopDataset(FOLDER / "data" / "tabletop").observation(1, 0)
    depth = np.round(observation.depth * 1000).astype(np.uint16)
    message = lcmt_image_array()
    message.header.utime = 42
    message.images = [
        as_message(observation.need_color(), lcmt_image.PIXEL_FORMAT_RGB),
        as_message(depth, lcmt_image.PIXEL_FORMAT_DEPTH),
    ]
    message.num_images = 2
    library = physim.ObjectLibrary.load(physim.models.APC11, {5})
    config = physim.EstimationConfig(physim.Method.SUPER4PCS_ICP)
    sent = lcmt_image_array.decode(message.encode())
    with physim.PoseEstimator(library, config) as estimator:
        reply = bridge.answer(sent, estimator, [physim.Detection(5, BOX)])
    answer = lcmt_viewer_draw.decode(reply.encode())
    assert (answer.timestamp, answer.link_name) == (42, ["up_glucose_bottle"])
    # The true position is in scene_gt.json.
    truth = physim.BopDataset(FOLDER / "data" / "tabletop").ground_truth(1, 0)
    (X_CO,) = (t.X_CO for t in truth if t.object_id == 5)
    np.testing.assert_allclose(answer.position[0], X_CO[:3, 3], atol=0.01)


def test_what_is_compressed_otherwise_is_refused() -> None:
    bridge = load("lcm_bridge")
    image = as_message(np.zeros((2, 3), np.uint16), lcmt_image.PIXEL_FORMAT_DEPTH)
    image.compression_method = lcmt_image.COMPRESSION_METHOD_JPEG
    with pytest.raises(physim.InputError, match="zlib"):
        bridge.decode(image)
