# SPDX-License-Identifier: MIT
"""A trained network as a detector: colour in, detections with masks out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from physim_drake.camera import DepthImage
from physim_drake.detection.networks.factory import ObjectClass, segmenter
from physim_drake.detection.networks.weights import load_weights
from physim_drake.errors import InputError
from physim_drake.observation.observation import Detection

_MASK_LEVEL = 0.5


class NetworkDetector:
    """Finds objects with a network.

    Args:
        network: `FasterRcnn`, or one that is called like it.
        classes: classes that it tells apart. Label k is the k-th, from 1.
        channels: channels of its images, 3, or 4 with depth.
        threads: CPU threads that it may use. None leaves the number to torch.
        device: device that it runs on.
        source: name in messages, for instance its file.

    Attributes:
        classes: classes that it tells apart.
        channels: channels of its images.
        source: name in messages.
    """

    def __init__(
        self,
        network: nn.Module,
        classes: tuple[ObjectClass, ...],
        channels: int = 3,
        threads: int | None = None,
        device: torch.device | None = None,
        source: Path | str = "the network",
    ) -> None:
        self._device = torch.device("cpu") if device is None else device
        self._network = network.to(self._device).eval()
        self._threads = threads
        self.classes, self.channels, self.source = classes, channels, str(source)

    @classmethod
    def load(
        cls,
        path: Path,
        threads: int | None = None,
        device: torch.device | None = None,
        *,
        pixels: bool = False,
    ) -> NetworkDetector:
        """Reads weights that `physim-drake train` wrote.

        Args:
            path: file of the weights.
            threads: see `NetworkDetector`.
            device: see `NetworkDetector`.
            pixels: use only the part that classifies every pixel, a fully
                convolutional network. It finds each object at most once and does not
                use boxes.

        Raises:
            InputError: if the weights cannot be used.
        """
        weights = load_weights(path)
        network = segmenter(weights.network) if pixels else weights.network
        channels = weights.network.config.channels
        return cls(network, weights.classes, channels, threads, device, path)

    def check_objects(self, names: Mapping[int, str], asker: Path | str) -> None:
        """Requires that the network knows certain objects.

        Args:
            names: names of the objects by id, empty if not known.
            asker: name in messages of where the objects come from.

        Raises:
            InputError: if it does not know an object, or knows it by another name.
        """
        known = {c.object_id: c.name for c in self.classes}
        for object_id, name in names.items():
            if object_id not in known:
                ids = ", ".join(str(c.object_id) for c in self.classes)
                what = f"object {object_id} of {asker} is not among {ids}"
            elif name and name != known[object_id]:
                what = (
                    f"object {object_id} of {asker} is {name}, here it is "
                    f"{known[object_id]}"
                )
            else:
                continue
            raise InputError(
                self.source,
                f"are weights for other objects: {what}",
                "give weights that were trained with these models, or detections",
            )

    def detect(
        self,
        color: NDArray[np.uint8],
        depth: DepthImage | None = None,
        least_score: float = 0.05,
    ) -> tuple[Detection, ...]:
        """Finds objects in an image.

        Args:
            color: (height, width, 3) RGB.
            depth: (height, width), m, 0 if not measured. Only networks with four
                channels need it.
            least_score: score below which detections are dropped.

        Returns:
            detections with masks, best first.

        Raises:
            InputError: if the network takes depth and the image has none.
        """
        image = self._tensor(color, depth)
        before = torch.get_num_threads()
        try:
            if self._threads is not None:
                torch.set_num_threads(self._threads)
            with torch.inference_mode():
                result = self._network([image.to(self._device)])[0]
        finally:
            torch.set_num_threads(before)
        return tuple(
            Detection(
                self.classes[label - 1].object_id,
                box.astype(float),
                float(score),
                mask,
            )
            for box, label, score, mask in zip(
                result["boxes"].cpu().numpy(),
                result["labels"].tolist(),
                result["scores"].tolist(),
                (result["masks"][:, 0] >= _MASK_LEVEL).cpu().numpy(),
                strict=True,
            )
            if score >= least_score
        )

    def _tensor(
        self, color: NDArray[np.uint8], depth: DepthImage | None
    ) -> torch.Tensor:
        planes = [color.transpose(2, 0, 1).astype(np.float32) / np.float32(255.0)]
        if self.channels == 4:
            if depth is None:
                raise InputError(
                    "image", "has no depth, which the network takes", "give depth"
                )
            planes.append(depth[None].astype(np.float32))
        return torch.from_numpy(np.concatenate(planes))
