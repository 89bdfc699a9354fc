# SPDX-License-Identifier: MIT
"""Draws camera poses and takes images of a scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from physim_drake.datasets.bop import mask_bounds
from physim_drake.objects.containers import Container, load_container
from physim_drake.objects.model import ObjectModel
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.poses import Array, inverse, make_pose, transform_points
from physim_drake.rendering.appearance import Appearance
from physim_drake.rendering.scene import Prop, SceneRenderer
from physim_drake.rendering.vivid import draw_appearance
from physim_drake.scenes.clutter import draw_distractors, draw_room
from physim_drake.scenes.generation import GeneratedScene
from physim_drake.sensors.color_noise import ColorNoise, expose
from physim_drake.sensors.depth_noise import DepthNoise, measure_depth
from physim_drake.sensors.presets import PRESETS, CameraName, CameraPreset

Masks = NDArray[np.bool_]

_FEW_OBJECTS = 6  # that the camera sees from its usual distance
_WIDTH = 0.45  # m; more objects, on a wider area, are looked at from farther


@dataclass(frozen=True)
class ViewConfig:
    """Settings of the images of a scene.

    Attributes:
        camera: name of the camera preset.
        noise: True for a camera with noise, False for perfect images.
        min_visible: least share of its silhouette that every object shows.
        distance: range from the camera to the middle of the objects, m; it grows with
            the width if more than six objects spread wide.
        max_roll: greatest roll of the camera about its axis, rad.
        max_tries: greatest number of views that are drawn until one shows every object
            whole.
        box_jitter: greatest error of each side of a detected box, as a share of its
            size.
        height: range of the camera's height, m, within the container's elevations;
            replaces `distance`.
        vivid: True to draw lights, surfaces and a room from a wide range for each
            view, as training needs; otherwise all views share one plain appearance.
        distractors: greatest number of other shapes in a vivid view.
    """

    camera: CameraName = CameraName.D415
    noise: bool = True
    min_visible: float = 0.25
    distance: tuple[float, float] = (0.5, 0.9)
    max_roll: float = 0.1
    max_tries: int = 40
    box_jitter: float = 0.06
    height: tuple[float, float] | None = None
    vivid: bool = False
    distractors: int = 0

    @property
    def preset(self) -> CameraPreset:
        """The camera."""
        return PRESETS[self.camera]


@dataclass(frozen=True)
class SceneView:
    """One image of a scene with its ground truth.

    Attributes:
        observation: the image with its camera; X_WC is exact.
        true_depth: depth without noise, (height, width), m.
        X_CO: poses of the objects in the camera, (N, 4, 4), m.
        silhouettes: pixels that each object would cover alone, (N, height, width).
        visible: pixels that show each object, (N, height, width).
    """

    observation: RgbdObservation
    true_depth: NDArray[np.float32]
    X_CO: Array
    silhouettes: Masks
    visible: Masks

    @property
    def visible_fractions(self) -> Array:
        """Visible share of each silhouette, (N,); 0 if the silhouette is empty."""
        seen, all_ = self.visible.sum(axis=(1, 2)), self.silhouettes.sum(axis=(1, 2))
        return np.asarray(seen / np.maximum(all_, 1))


class NotSeenError(Exception):
    """No view shows all objects of a scene well enough."""


def draw_camera(
    scene: GeneratedScene,
    container: Container,
    config: ViewConfig,
    rng: np.random.Generator,
) -> Array:
    """A pose X_WC (4, 4) that looks at the middle of the objects."""
    azimuth = rng.uniform(*container.azimuth)
    elevation = rng.uniform(*container.elevation)
    if config.height is None:
        distance = _farther(scene) * rng.uniform(*config.distance)
    else:
        distance = rng.uniform(*config.height) / np.sin(elevation)
    target = scene.X_WO[:, :3, 3].mean(axis=0) + rng.uniform(-0.03, 0.03, 3)
    backward = np.array(
        [
            np.cos(azimuth) * np.cos(elevation),
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
        ]
    )
    z_C = -backward
    x_C = np.cross(z_C, [0.0, 0.0, 1.0])
    x_C /= np.linalg.norm(x_C)
    R_WC = np.stack([x_C, np.cross(z_C, x_C), z_C], axis=1)
    roll = Rotation.from_rotvec([0, 0, rng.uniform(-config.max_roll, config.max_roll)])
    return make_pose(R_WC @ roll.as_matrix(), target + distance * backward)


def _farther(scene: GeneratedScene) -> float:
    """Factor of the distance with which the camera sees the whole of a wide scene."""
    if len(scene.object_ids) <= _FEW_OBJECTS:
        return 1.0
    return max(1.0, float(np.ptp(scene.X_WO[:, :2, 3], axis=0).max()) / _WIDTH)


def find_view(
    scene: GeneratedScene,
    renderer: SceneRenderer,
    config: ViewConfig,
    rng: np.random.Generator,
) -> Array:
    """A pose X_WC (4, 4) from which every object is visible and whole in the image.

    Raises:
        NotSeenError: if no such pose is found.
    """
    container = load_container(scene.container)
    for _ in range(config.max_tries):
        X_WC = draw_camera(scene, container, config, rng)
        silhouettes, visible = _masks(scene, renderer, X_WC, config.preset)
        sizes = silhouettes.sum(axis=(1, 2))
        inner = silhouettes[:, 1:-1, 1:-1].sum(axis=(1, 2))
        enough = visible.sum(axis=(1, 2)) >= config.min_visible * sizes
        if (sizes > 0).all() and (inner == sizes).all() and enough.all():
            return X_WC
    raise NotSeenError


def render_view(
    scene: GeneratedScene,
    renderer: SceneRenderer,
    X_WC: Array,
    rng: np.random.Generator,
    camera: CameraPreset = PRESETS[CameraName.D415],
    depth_noise: DepthNoise | None = None,
    color_noise: ColorNoise | None = None,
) -> SceneView:
    """Takes an image of a scene.

    Args:
        scene: the scene.
        renderer: renderer of its objects, from `make_renderer`.
        X_WC: camera pose, (4, 4), m.
        rng: source of the camera's noise.
        camera: intrinsics and depth noise of the camera.
        depth_noise: noise that replaces the camera's.
        color_noise: noise of the colour image; None for a perfect one.
    """
    noise = camera.noise if depth_noise is None else depth_noise
    images = renderer.render(scene.X_WO, X_WC, camera.intrinsics)
    X_WD = X_WC @ noise.draw_extrinsic_error(rng)
    seen = images.depth
    if not np.array_equal(X_WD, X_WC):
        seen = renderer.render_depth(scene.X_WO, X_WD, camera.intrinsics)
    depth = measure_depth(seen, camera.intrinsics, noise, rng, images.echo)
    color = images.color
    if color_noise is not None:
        color = expose(color, color_noise, rng)
    silhouettes, visible = _masks(scene, renderer, X_WC, camera)
    return SceneView(
        RgbdObservation(depth, camera.intrinsics, color, X_WC),
        images.depth,
        inverse(X_WC) @ scene.X_WO,
        silhouettes,
        visible,
    )


def make_renderer(
    scene: GeneratedScene,
    visuals: Sequence[Path],
    appearance: Appearance,
    props: Sequence[Prop] = (),
) -> SceneRenderer:
    """A renderer of a scene; `visuals` are textured OBJ files of its objects."""
    return SceneRenderer(visuals, load_container(scene.container), appearance, props)


def make_vivid_renderer(
    scene: GeneratedScene,
    visuals: Sequence[Path],
    objects: Sequence[ObjectModel],
    distractors: int,
    rng: np.random.Generator,
) -> SceneRenderer:
    """A renderer of a scene with random lights, surfaces and surroundings.

    Args:
        scene: the scene.
        visuals: textured OBJ files of its objects.
        objects: models of its objects.
        distractors: greatest number of other shapes.
        rng: source of all random choices.
    """
    circles = []
    for model, X_WO in zip(objects, scene.X_WO, strict=True):
        xy = transform_points(X_WO, model.mesh.vertices)[:, :2]
        middle = (xy.min(axis=0) + xy.max(axis=0)) / 2
        circles.append([*middle, np.linalg.norm(xy - middle, axis=1).max()])
    height = load_container(scene.container).height
    props = draw_distractors(np.array(circles), distractors, height, rng)
    return make_renderer(
        scene, visuals, draw_appearance(rng), [*props, *draw_room(rng)]
    )


def jittered_detections(
    view: SceneView,
    object_ids: Sequence[int],
    jitter: float,
    rng: np.random.Generator,
) -> list[Detection]:
    """The true visible boxes, each side off by up to `jitter` of the box's size."""
    return jittered_boxes(view.visible, object_ids, jitter, rng)


def jittered_boxes(
    masks: Masks, object_ids: Sequence[int], jitter: float, rng: np.random.Generator
) -> list[Detection]:
    """The boxes of masks (N, height, width), jittered like `jittered_detections`."""
    height, width = masks.shape[1:]
    limits = np.array([width, height, width, height], dtype=float)
    detections = []
    for object_id, mask in zip(object_ids, masks, strict=True):
        box = mask_bounds(mask)
        size = np.tile(box[2:] - box[:2], 2)
        box = np.clip(box + rng.uniform(-jitter, jitter, 4) * size, 0.0, limits)
        detections.append(Detection(object_id, box, float(rng.uniform(0.9, 1.0))))
    return detections


def _masks(
    scene: GeneratedScene, renderer: SceneRenderer, X_WC: Array, camera: CameraPreset
) -> tuple[Masks, Masks]:
    """Silhouettes and visible parts of the objects, both (N, height, width)."""
    labels = renderer.visible_labels(scene.X_WO, X_WC, camera.intrinsics)
    count = range(len(scene.object_ids))
    silhouettes = np.stack(
        [renderer.silhouette(n, scene.X_WO, X_WC, camera.intrinsics) for n in count]
    )
    visible = labels == np.arange(len(count))[:, None, None]
    # An edge pixel may be missing when an object is drawn alone.
    return silhouettes | visible, visible
