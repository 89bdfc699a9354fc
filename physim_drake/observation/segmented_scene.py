# SPDX-License-Identifier: MIT
"""One image made ready for estimation: its segments on their support surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from physim_drake.camera import CameraIntrinsics, DepthImage
from physim_drake.observation.object_sizes import UNKNOWN_SIZES, ObjectSizes
from physim_drake.observation.observation import Detection, RgbdObservation, Segment
from physim_drake.observation.segmentation import (
    foreground,
    foreground_in_air,
    segment_objects,
)
from physim_drake.observation.support_surface import SupportSurface
from physim_drake.poses import Array


@dataclass(frozen=True)
class SegmentedScene:
    """What every later step works on; small enough to send to a worker.

    Attributes:
        segments: one for each object to find.
        depth: the depth image as it was measured, m, 0 if unknown.
        observed: the same with the support surface set to 0.
        intrinsics: intrinsics of the camera.
        X_CS: pose of the support frame in the camera, (4, 4).
        supported: whether the plane z = 0 of S carries the objects.
    """

    segments: Sequence[Segment]
    depth: DepthImage
    observed: DepthImage
    intrinsics: CameraIntrinsics
    X_CS: Array
    supported: bool = True

    @property
    def object_ids(self) -> tuple[int, ...]:
        """Which object each segment is of."""
        return tuple(segment.object_id for segment in self.segments)


def prepare_scene(
    observation: RgbdObservation,
    surface: SupportSurface,
    detections: Sequence[Detection],
    sizes: ObjectSizes = UNKNOWN_SIZES,
) -> SegmentedScene:
    """Cuts an observation into the segments of its detections.

    Args:
        observation: the image.
        surface: what the objects rest on.
        detections: where they are.
        sizes: of the objects; voxels and heights follow them.
    """
    if surface.known:
        observed = foreground(observation, surface, detections, sizes)
    else:
        observed = foreground_in_air(observation, detections, sizes)
    K = observation.intrinsics
    segments = segment_objects(observed, K, surface, detections, sizes.factor)
    return SegmentedScene(
        segments, observation.depth, observed, K, surface.X_CS, surface.known
    )
