# SPDX-License-Identifier: MIT
"""Depth images of single objects as small windows of the whole image.

An object fills a few per cent of an image. A state of the search is cheap to score
because only those are drawn, kept, composited and compared.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from physim_drake.camera import CameraIntrinsics, DepthImage
from physim_drake.compiled import compiled
from physim_drake.poses import Array


@dataclass(frozen=True)
class DepthWindow:
    """The part of a depth image that shows an object.

    Attributes:
        row: row of the image at the window's first row.
        column: column of the image at the window's first column.
        depth: depth z, m, (height, width) float32, 0 beside the object.
    """

    row: int
    column: int
    depth: DepthImage

    def of(self, image: np.ndarray) -> np.ndarray:
        """The window's pixels of an image, as a view."""
        height, width = self.depth.shape
        return image[self.row : self.row + height, self.column : self.column + width]


class ObjectRenderer(Protocol):
    """Draws objects one at a time."""

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """Of the camera."""
        ...

    def window(self, object_id: int, X_CO: Array) -> DepthWindow:
        """Draws the object alone, at a pose (4, 4) in the camera."""
        ...


def crop(image: DepthImage) -> DepthWindow:
    """The smallest window of an image that holds all that is drawn in it."""
    rows, columns = np.flatnonzero(image.any(axis=1)), np.flatnonzero(image.any(axis=0))
    if len(rows) == 0:
        return DepthWindow(0, 0, image[:0, :0])
    part = image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return DepthWindow(int(rows[0]), int(columns[0]), part)


def paste(image: DepthImage, window: DepthWindow) -> None:
    """Draws a window into an image, in place. The nearer depth wins."""
    _paste(image, window.row, window.column, np.ascontiguousarray(window.depth))


@compiled()
def _paste(image: DepthImage, row: int, column: int, window: DepthImage) -> None:
    for i in range(window.shape[0]):
        for j in range(window.shape[1]):
            new, old = window[i, j], image[row + i, column + j]
            if new > 0 and (old == 0 or new < old):
                image[row + i, column + j] = new
