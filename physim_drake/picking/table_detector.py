# SPDX-License-Identifier: MIT
"""Detections on the table alone: what is in the tote is done."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physim_drake.observation.detector import DetectionAlgorithm, LabelImage
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.picking.tote import Tote
from physim_drake.poses import Array, transform_points

_MIDDLE = 0.5  # share of a box's sides that is looked at


class TableDetector:
    """Leaves out what another detector finds in the tote, by the depth there.

    Args:
        detector: detector whose detections are filtered.
        tote: region that is left out.
    """

    def __init__(self, detector: DetectionAlgorithm, tote: Tote) -> None:
        self._detector, self._tote = detector, tote

    def detect(
        self,
        observation: RgbdObservation,
        labels: LabelImage | None,
        generator: np.random.Generator,
    ) -> tuple[Detection, ...]:
        """Finds the objects that are not in the tote."""
        found = self._detector.detect(observation, labels, generator)
        return tuple(d for d in found if not self._in_tote(d, observation))

    def _in_tote(self, detection: Detection, observation: RgbdObservation) -> bool:
        p_W = middle_points(detection, observation)
        return len(p_W) > 0 and self._tote.holds(np.median(p_W, axis=0))


def middle_points(detection: Detection, observation: RgbdObservation) -> Array:
    """The points p_W (N, 3) seen in a mask, or in the middle of a box without one.

    There are no points if the camera's pose is not known.
    """
    if observation.X_WC is None:
        return np.zeros((0, 3))
    if detection.mask is not None:
        p_C = observation.intrinsics.unproject(observation.depth)
        seen = detection.mask & (observation.depth > 0)
        return transform_points(observation.X_WC, p_C[seen])
    left, top, right, bottom = detection.box
    x, y = (left + right) / 2, (top + bottom) / 2
    half_x, half_y = _MIDDLE * (right - left) / 2, _MIDDLE * (bottom - top) / 2
    rows = _indices(y - half_y, y + half_y, observation.depth.shape[0])
    columns = _indices(x - half_x, x + half_x, observation.depth.shape[1])
    z = observation.depth[np.ix_(rows, columns)].astype(float)
    v, u = np.meshgrid(rows, columns, indexing="ij")
    K = observation.intrinsics
    p_C = np.stack([(u - K.cx) * z / K.fx, (v - K.cy) * z / K.fy, z], axis=-1)
    return transform_points(observation.X_WC, np.asarray(p_C[z > 0], np.float64))


def _indices(low: float, high: float, size: int) -> NDArray[np.intp]:
    first = int(np.clip(np.floor(low), 0, size - 1))
    last = int(np.clip(np.ceil(high), first + 1, size))
    return np.arange(first, last)
