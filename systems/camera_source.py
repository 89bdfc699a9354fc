# SPDX-License-Identifier: MIT
"""Looks at a simulated scene with a camera that errs like a real one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context
from pydrake.systems.sensors import (
    CameraConfig,
    ImageDepth32F,
    ImageLabel16I,
    ImageRgba8U,
    RgbdSensor,
)

from physim_drake.camera import CameraIntrinsics
from physim_drake.errors import InputError
from physim_drake.observation.detector import LabelImage
from physim_drake.observation.observation import RgbdObservation
from physim_drake.rendering.camera_core import core_intrinsics
from physim_drake.sensors.color_noise import ColorNoise, expose
from physim_drake.sensors.depth_noise import DepthNoise, measure_depth
from physim_drake.sensors.presets import PRESETS, CameraName
from physim_drake.systems.source import Source
from physim_drake.systems.stage import EACH_STEP, TimingConfig


@dataclass(frozen=True)
class CameraSourceConfig:
    """A camera and its errors.

    Attributes:
        preset: name of the camera whose errors are imitated, and whose field of view a
            camera has that is made from this configuration.
        width: width of the image, px; the preset's if it is None.
        height: height of the image, px; the preset's if it is None.
        depth_noise: whether depth has errors.
        color_noise: whether colour has errors.
        reflections: whether depth is also lost on dark and shiny surfaces; needs the
            image by a lamp at the camera, `echo_image`.
        seed: seed of all errors; those of the n-th look are always the same.
    """

    preset: CameraName = CameraName.D415
    width: int | None = None
    height: int | None = None
    depth_noise: bool = True
    color_noise: bool = True
    reflections: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            size = getattr(self, name)
            if size is not None and size < 1:
                raise InputError("camera", f"is {size}", "give pixels, above 0", name)

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """The preset's intrinsics for the image's size, with the same field of view."""
        K = PRESETS[self.preset].intrinsics
        width, height = self.width or K.width, self.height or K.height
        x, y = width / K.width, height / K.height
        # Pixel centres are at integers, so that the image begins at -0.5.
        cx, cy = (K.cx + 0.5) * x - 0.5, (K.cy + 0.5) * y - 0.5
        return CameraIntrinsics(width, height, K.fx * x, K.fy * y, cx, cy)

    @property
    def noise(self) -> DepthNoise:
        """The errors of depth."""
        if not self.depth_noise:
            return DepthNoise.none()
        noise = PRESETS[self.preset].noise
        if self.reflections:
            return noise
        return replace(noise, dark_loss=0.0, shiny_loss=0.0)

    def draw_extrinsic_error(self) -> NDArray[np.float64]:
        """X_CD (4, 4) of this camera's depth sensor D, which should be at C.

        A camera keeps it for life, as it does the error of its calibration.
        """
        return self.noise.draw_extrinsic_error(np.random.default_rng([self.seed, 0]))


class CameraSource(Source):
    """Makes an observation of the images of an RgbdSensor.

    .. pydrake_system::

        name: CameraSource
        input_ports:
        - trigger (optional with a period)
        - color_image
        - depth_image_32f
        - label_image (optional)
        - echo_image (optional)
        - X_WC
        output_ports:
        - observation
        - labels

    Inputs: ``trigger`` see `Source`; ``color_image`` (ImageRgba8U),
    ``depth_image_32f`` (ImageDepth32F, m) and ``label_image`` (ImageLabel16I) without
    errors; ``echo_image`` (ImageRgba8U), the colour by the light of a lamp at the
    camera alone; ``X_WC`` (RigidTransform), pose of the camera's optical frame. They
    are evaluated, and so images are rendered, only when a look is begun.

    Outputs: ``observation`` (Stamped[RgbdObservation]), whose X_WC is exact; ``labels``
    (Stamped of an int16 image (height, width)), without a value if ``label_image``
    is not connected.

    Args:
        camera: what makes the images: the sensor, its configuration or its intrinsics.
            Intrinsics of observations are those of this camera, never the preset's.
        config: errors of the camera.
        period: see `Source`.
        timing: see `Source`.

    Raises:
        InputError: if colour and depth have other intrinsics than each other, or the
            image has another size than ``config`` asks for.
    """

    def __init__(
        self,
        camera: RgbdSensor | CameraConfig | CameraIntrinsics,
        config: CameraSourceConfig = CameraSourceConfig(),
        period: float | None = None,
        timing: TimingConfig = EACH_STEP,
    ) -> None:
        outputs = {"observation": RgbdObservation, "labels": LabelImage}
        super().__init__(outputs, period, timing)
        self._config, self._intrinsics = config, _intrinsics(camera)
        _check_size(config, self._intrinsics)
        self._color = self._declare_input("color_image", ImageRgba8U(1, 1))
        self._depth = self._declare_input("depth_image_32f", ImageDepth32F(1, 1))
        self._label = self._declare_input("label_image", ImageLabel16I(1, 1))
        self._echo = self._declare_input("echo_image", ImageRgba8U(1, 1))
        self._pose = self._declare_input("X_WC", RigidTransform())

    def _declare_input(self, name: str, model: Any) -> Any:
        return self.DeclareAbstractInputPort(name, Value(model))

    def capture(self, context: Context, number: int) -> tuple[Any, ...]:
        """Renders the scene, and adds what the camera does to it."""
        config = self._config
        rng = np.random.default_rng([config.seed, number])
        true_depth = _pixels(self._depth, context)[..., 0]
        depth = measure_depth(
            np.where(np.isfinite(true_depth), true_depth, np.float32(0)),
            self._intrinsics,
            config.noise,
            rng,
            self._optional_pixels(self._echo, context),
        )
        color = np.ascontiguousarray(_pixels(self._color, context)[..., :3])
        if config.color_noise:
            color = expose(color, ColorNoise(), rng)
        labels = self._optional_pixels(self._label, context)
        # All contexts share what is in a port.
        for image in (depth, color):
            image.flags.writeable = False
        X_WC = self._pose.Eval(context).GetAsMatrix4()
        observation = RgbdObservation(
            depth, self._intrinsics, color, X_WC, f"look {number}"
        )
        return observation, None if labels is None else labels[..., 0]

    def _optional_pixels(self, port: Any, context: Context) -> Any:
        if not port.HasValue(context):
            return None
        pixels = _pixels(port, context)
        return pixels[..., :3] if pixels.shape[2] == 4 else pixels


def _intrinsics(
    camera: RgbdSensor | CameraConfig | CameraIntrinsics,
) -> CameraIntrinsics:
    """The intrinsics that the camera's colour and depth share."""
    if isinstance(camera, CameraIntrinsics):
        return camera
    if isinstance(camera, CameraConfig):
        color, depth = camera.MakeCameras()
    elif isinstance(camera, RgbdSensor):
        color = camera.default_color_render_camera()
        depth = camera.default_depth_render_camera()
    else:
        raise TypeError(
            "CameraSource: the camera must be an RgbdSensor, a CameraConfig or "
            f"CameraIntrinsics, not {type(camera).__name__}"
        )
    of_color, of_depth = core_intrinsics(color.core()), core_intrinsics(depth.core())
    if of_color != of_depth:
        raise InputError(
            "camera",
            f"colour and depth differ in their intrinsics: {of_color}, {of_depth}",
            "give both the same, so that pixels show the same",
        )
    return of_color


def _check_size(config: CameraSourceConfig, K: CameraIntrinsics) -> None:
    for name, size in (("width", K.width), ("height", K.height)):
        wanted = getattr(config, name)
        if wanted not in (None, size):
            raise InputError(
                "camera",
                f"is {wanted}, and the camera's is {size}",
                "leave it out: the size of the image is the camera's",
                name,
            )


def _pixels(port: Any, context: Context) -> Any:
    """A copy (height, width, channels) of the image at a port."""
    pixels = np.array(port.Eval(context).data)
    pixels.flags.writeable = False
    return pixels
