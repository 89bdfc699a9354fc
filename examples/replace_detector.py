# SPDX-License-Identifier: MIT
"""Puts your own detector into the perception diagram.

    python examples/replace_detector.py

Any object with a method `detect` is a detector. This one takes what stands out of the
table for the objects and tells them apart by their colours. It does not ask the
simulator where they are.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from perception_diagram import FOLDER, main
from scipy.optimize import linear_sum_assignment

from physim_drake.datasets.images import read_color
from physim_drake.objects import ObjectLibrary
from physim_drake.observation import Detection, RgbdObservation
from physim_drake.poses import transform_points
from physim_drake.systems import PerceptionConfig

NAMES = ("folgers_classic_roast_coffee", "dove_beauty_bar", "crayola_24_ct")
HEIGHT = 0.01  # m; what is higher above the table is not the table
FEWEST = 200  # pixels of an object


class ColorDetector:
    """Tells apart a few objects that do not touch; the table is at z = 0.

    Args:
        library: the objects.
        names: which of them are there.
    """

    def __init__(self, library: ObjectLibrary, names: tuple[str, ...]) -> None:
        self._ids, tints = [], []
        for model in map(library.by_name, names):
            assert model.texture is not None, f"{model.name} has no texture"
            self._ids.append(model.object_id)
            tints.append(tint(read_color(model.texture)))
        self._tints = np.stack(tints)

    def detect(
        self,
        observation: RgbdObservation,
        labels: NDArray[np.int16] | None,
        generator: np.random.Generator,
    ) -> tuple[Detection, ...]:
        """Finds each of the objects at most once."""
        assert observation.X_WC is not None
        assert observation.color is not None
        p_C = observation.intrinsics.unproject(observation.depth)
        z_W = transform_points(observation.X_WC, p_C.reshape(-1, 3))[:, 2]
        high = (z_W.reshape(observation.depth.shape) > HEIGHT) & (observation.depth > 0)
        count, regions = cv2.connectedComponents(high.astype(np.uint8))
        masks = [regions == k for k in range(1, count)]
        masks = [mask for mask in masks if mask.sum() >= FEWEST]
        if not masks:
            return ()
        tints = np.stack([tint(observation.color[mask]) for mask in masks])
        costs = np.linalg.norm(tints[:, None] - self._tints, axis=2)
        return tuple(
            Detection(self._ids[j], box(masks[i]), mask=masks[i])
            for i, j in zip(*linear_sum_assignment(costs), strict=True)
        )


def tint(pixels: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Shares of red, green and blue, (3,), whatever the light."""
    mean = pixels.reshape(-1, 3).mean(axis=0)
    return np.asarray(mean / mean.sum())


def box(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Left, top, right, bottom of a mask, px."""
    left, top, width, height = cv2.boundingRect(mask.astype(np.uint8))
    return np.array([left, top, left + width, top + height], dtype=float)


# More than one worker means processes, and those import this file again.
if __name__ == "__main__":
    settings = PerceptionConfig.load(FOLDER / "perception.yaml")
    detector = ColorDetector(settings.load_library(), NAMES)
    main(settings, FOLDER / "apart.dmd.yaml", detector)
