# SPDX-License-Identifier: MIT
"""A camera in the terms of Drake's renderers."""

from __future__ import annotations

from typing import Any

from pydrake.geometry import ClippingRange, RenderCameraCore
from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo

from physim_drake.camera import CameraIntrinsics

NEAR, FAR = 0.05, 8.0
"""Nothing that is nearer or farther is rendered, m."""


def core_intrinsics(core: RenderCameraCore) -> CameraIntrinsics:
    """The intrinsics of a camera of Drake's; the inverse of `camera_core`."""
    camera: Any = core  # whose type Drake's stubs do not have
    info = camera.intrinsics()
    return CameraIntrinsics(
        info.width(),
        info.height(),
        info.focal_x(),
        info.focal_y(),
        info.center_x() - 0.5,
        info.center_y() - 0.5,
    )


def camera_core(
    intrinsics: CameraIntrinsics,
    engine: str,
    far: float = FAR,
    X_BS: RigidTransform | None = None,
) -> RenderCameraCore:
    """A camera for one of a scene graph's renderers.

    Args:
        intrinsics: intrinsics of the images.
        engine: name of the renderer.
        far: distance beyond which nothing is rendered, m.
        X_BS: pose of the camera in the sensor's body; the identity by default.
    """
    # Drake's pixel centres lie at half integers.
    info = CameraInfo(
        width=intrinsics.width,
        height=intrinsics.height,
        focal_x=intrinsics.fx,
        focal_y=intrinsics.fy,
        center_x=intrinsics.cx + 0.5,
        center_y=intrinsics.cy + 0.5,
    )
    pose = RigidTransform() if X_BS is None else X_BS
    return RenderCameraCore(engine, info, ClippingRange(NEAR, far), pose)
