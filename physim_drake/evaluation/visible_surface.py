# SPDX-License-Identifier: MIT
"""The visible surface discrepancy (VSD) of the BOP challenge 2019.

Hodan et al., "BOP: Benchmark for 6D Object Pose Estimation", ECCV 2018, section 3.3,
with the parameters of 2019: step cost, distances normalised by the diameter, and
pixels without a measurement counted as visible.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from physim_drake.camera import CameraIntrinsics, DepthImage
from physim_drake.observation.observation import Mask
from physim_drake.poses import Array

VSD_DELTA = 0.015
"""Greatest depth behind the measured surface at which a model is visible, m."""

VSD_TAUS = np.linspace(0.05, 0.5, 10)
"""Misalignment tolerances, in diameters."""


class RenderDepth(Protocol):
    """Renders one object alone."""

    def render(self, object_id: int, X_CO: Array, /) -> DepthImage:
        """Depth (height, width), m, of the object at `X_CO`; 0 outside it."""
        ...


@dataclass(frozen=True)
class SceneDistances:
    """The measured image as distances from the camera's centre.

    Attributes:
        measured: (height, width), m; 0 at pixels without a measurement.
        per_depth: (height, width), ratio of distance to depth of each pixel.
    """

    measured: Array
    per_depth: Array

    @classmethod
    def from_depth(
        cls, depth: DepthImage, intrinsics: CameraIntrinsics
    ) -> SceneDistances:
        """Converts a depth image, m."""
        per_depth = np.linalg.norm(intrinsics.rays(), axis=2)
        return cls(depth * per_depth, per_depth)


def vsd(
    scene: SceneDistances,
    depth_true: DepthImage,
    depth_estimated: DepthImage,
    diameter: float,
) -> Array:
    """The discrepancy 0..1 at each of `VSD_TAUS`.

    Args:
        scene: the measured image.
        depth_true: the object at its true pose, (height, width), m.
        depth_estimated: the object at its estimated pose, (height, width), m.
        diameter: diameter of the object, m.
    """
    true, estimated = depth_true * scene.per_depth, depth_estimated * scene.per_depth
    visible_true = _visible(scene.measured, true)
    # At pixels that show the true object the estimate may hide behind its surface.
    visible_estimated = _visible(scene.measured, estimated)
    visible_estimated |= visible_true & (estimated > 0)
    union = int((visible_true | visible_estimated).sum())
    if union == 0:
        return np.ones(len(VSD_TAUS))
    both = visible_true & visible_estimated
    apart = np.abs(true[both] - estimated[both]) / diameter
    wrong = (apart[:, None] >= VSD_TAUS).sum(axis=0)
    return np.asarray((wrong + union - int(both.sum())) / union)


def _visible(measured: Array, model: Array) -> Mask:
    in_front = (model - measured <= VSD_DELTA) | (measured == 0)
    return np.asarray(in_front & (model > 0))
