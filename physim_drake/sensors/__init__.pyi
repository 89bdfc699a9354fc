# SPDX-License-Identifier: MIT
from .camera_name import CameraName as CameraName
from .color_noise import ColorNoise as ColorNoise
from .color_noise import expose as expose
from .depth_noise import DepthNoise as DepthNoise
from .depth_noise import measure_depth as measure_depth
from .presets import CameraPreset as CameraPreset
