# SPDX-License-Identifier: MIT
"""RealSense-like cameras: intrinsics and the noise that goes with them.

Depth is registered to colour at 640 x 480, as drivers deliver it. The disparities that
carry the noise are those of the depth sensor itself. Sources: realsense-ros
(`realsense2_description`: baselines), librealsense issues 2367 (nearest range f B /
126), 3904 (sub-pixel error 0.08 px), 2788 and 10838 (intrinsics), and Intel's "Best
known methods for tuning D4xx cameras" (the z^2 law).
"""

from __future__ import annotations

from dataclasses import dataclass

from physim_drake.camera import CameraIntrinsics
from physim_drake.sensors.camera_name import CameraName as CameraName
from physim_drake.sensors.depth_noise import DepthNoise


@dataclass(frozen=True)
class CameraPreset:
    """A camera.

    Attributes:
        intrinsics: intrinsics of depth and colour.
        noise: errors of its depth.
    """

    intrinsics: CameraIntrinsics
    noise: DepthNoise


PRESETS = {
    # 848 x 480 depth of 65 degrees: f 665 px.
    CameraName.D415: CameraPreset(
        CameraIntrinsics(640, 480, 615.0, 615.0, 320.0, 240.0),
        DepthNoise(focal_length=665.0, baseline=0.055, min_range=0.29, max_range=10.0),
    ),
    # 848 x 480 depth of 90 degrees: f 427 px.
    CameraName.D435: CameraPreset(
        CameraIntrinsics(640, 480, 610.3, 610.3, 323.51, 240.51),
        DepthNoise(focal_length=427.0, baseline=0.050, min_range=0.17, max_range=10.0),
    ),
    # Coded light has no disparity steps. Its error of 1.25e-3 z^2 (m) and the lateral
    # distance of its projector are assumptions. The z^2 law is that of triangulation.
    CameraName.SR300: CameraPreset(
        CameraIntrinsics(640, 480, 614.0, 614.0, 322.45, 239.68),
        DepthNoise(
            focal_length=475.0,
            baseline=0.047,
            disparity_error=1.25e-3 * 475.0 * 0.047,
            disparity_step=0.0,
            depth_unit=0.000125,
            min_range=0.2,
            max_range=1.5,
            grazing_cosine=0.25,
            dark_loss=0.5,
            shiny_loss=0.5,
            shadow_side=-1,
        ),
    ),
}
