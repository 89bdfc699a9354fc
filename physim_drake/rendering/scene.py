# SPDX-License-Identifier: MIT
"""Colour, depth and label images of whole scenes, with RenderEngineVtk.

Objects have the textures of their Drake models. Lights, and the looks of the container,
come from an `Appearance`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    Box,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    LightParameter,
    MakeRenderEngineVtk,
    Mesh,
    PerceptionProperties,
    RenderEngineVtkParams,
    RenderLabel,
    Rgba,
    SceneGraph,
    Shape,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from physim_drake.camera import CameraIntrinsics, DepthImage
from physim_drake.objects.containers import Container
from physim_drake.poses import Array, make_pose
from physim_drake.rendering.appearance import Appearance, Light
from physim_drake.rendering.camera_core import FAR, NEAR, camera_core
from physim_drake.storage.files import cannot_write
from physim_drake.storage.scratch import ScratchFolder

_ENGINE, _PROJECTOR_ENGINE = "vtk", "projector"
_CONTAINER_LABEL = 0
_PARKED = RigidTransform([0.0, 0.0, -100.0])

LabelImage = NDArray[np.int16]


@dataclass(frozen=True)
class SceneImages:
    """What an ideal camera sees.

    Attributes:
        color: RGB, (height, width, 3) uint8.
        depth: depth z, m, (height, width) float32, 0 in empty space.
        labels: index of the visible object, or -1, (height, width) int16.
        echo: RGB in the light of a lamp at the camera alone, (height, width, 3) uint8.
            The projector of a depth camera is such a lamp.
    """

    color: NDArray[np.uint8]
    depth: DepthImage
    labels: LabelImage
    echo: NDArray[np.uint8]


@dataclass(frozen=True)
class Prop:
    """A thing in a scene that is not one of its objects: visible, but without a label.

    Attributes:
        shape: shape, in Drake's terms.
        X_WP: pose, (4, 4).
        texture: RGB, (height, width, 3).
    """

    shape: Shape
    X_WP: Array
    texture: NDArray[np.uint8]


class SceneRenderer:
    """Renders one set of objects in one container.

    Args:
        visuals: textured OBJ file of each object, in metres.
        container: container that they stand on or in.
        appearance: lights and surfaces.
        props: other visible things.

    It holds an OpenGL context. Objects can be moved, but lights cannot.
    """

    def __init__(
        self,
        visuals: Sequence[Path],
        container: Container,
        appearance: Appearance,
        props: Sequence[Prop] = (),
    ) -> None:
        builder = DiagramBuilder()
        graph = SceneGraph()
        builder.AddSystem(graph)
        self._graph: Any = graph
        for name, look in (
            (_ENGINE, appearance),
            (_PROJECTOR_ENGINE, Appearance.plain()),
        ):
            self._graph.AddRenderer(name, MakeRenderEngineVtk(_params(look)))
        self._source = self._graph.RegisterSource("scene")
        self._frames = [self._add_frame("container")]
        boxes = zip(container.boxes, appearance.textures(container), strict=True)
        surface = [
            Prop(Box(*box.size), make_pose(p=box.center), texture)
            for box, texture in boxes
        ]
        self._add_props([*surface, *props])
        for n, path in enumerate(visuals):
            self._frames.append(self._add_frame(f"object_{n}"))
            self._add(self._frames[-1], RigidTransform(), Mesh(path), n + 1, {})
        builder.ExportOutput(self._graph.get_query_output_port(), "query")
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._query: Any = self._diagram.GetOutputPort("query").Eval(self._context)

    def render(
        self, X_WO: Array, X_WC: Array, intrinsics: CameraIntrinsics
    ) -> SceneImages:
        """Renders the scene.

        Args:
            X_WO: poses of the objects, (N, 4, 4).
            X_WC: pose of the camera, (4, 4).
            intrinsics: intrinsics of the camera.
        """
        self._set_poses(X_WO, container=True)
        labels = self._labels(X_WC, intrinsics)
        return SceneImages(
            self._color(X_WC, intrinsics, _ENGINE),
            self._depth(X_WC, intrinsics),
            labels,
            self._color(X_WC, intrinsics, _PROJECTOR_ENGINE),
        )

    def render_depth(
        self, X_WO: Array, X_WC: Array, intrinsics: CameraIntrinsics
    ) -> DepthImage:
        """The depth image alone. The arguments are those of `render`."""
        self._set_poses(X_WO, container=True)
        return self._depth(X_WC, intrinsics)

    def visible_labels(
        self, X_WO: Array, X_WC: Array, intrinsics: CameraIntrinsics
    ) -> LabelImage:
        """The label image alone. The arguments are those of `render`."""
        self._set_poses(X_WO, container=True)
        return self._labels(X_WC, intrinsics)

    def silhouette(
        self, n: int, X_WO: Array, X_WC: Array, intrinsics: CameraIntrinsics
    ) -> NDArray[np.bool_]:
        """The pixels (height, width) that object `n` alone would cover."""
        self._set_poses(X_WO, container=False, only=n)
        return np.asarray(self._labels(X_WC, intrinsics) == n)

    def _set_poses(
        self, X_WO: Array, *, container: bool, only: int | None = None
    ) -> None:
        poses = FramePoseVector()
        poses.set_value(self._frames[0], RigidTransform() if container else _PARKED)
        for n, (frame, X) in enumerate(zip(self._frames[1:], X_WO, strict=True)):
            shown = only is None or only == n
            poses.set_value(frame, RigidTransform(X) if shown else _PARKED)
        port = self._graph.get_source_pose_port(self._source)
        port.FixValue(self._graph.GetMyContextFromRoot(self._context), poses)

    def _labels(self, X_WC: Array, intrinsics: CameraIntrinsics) -> LabelImage:
        image = self._query.RenderLabelImage(
            camera=ColorRenderCamera(camera_core(intrinsics, _ENGINE)),
            parent_frame=self._graph.world_frame_id(),
            X_PC=RigidTransform(X_WC),
        )
        labels = np.array(image.data[:, :, 0], dtype=np.int16) - 1
        labels[labels >= len(self._frames) - 1] = -1  # empty space
        return labels

    def _color(
        self, X_WC: Array, intrinsics: CameraIntrinsics, engine: str
    ) -> NDArray[np.uint8]:
        image = self._query.RenderColorImage(
            camera=ColorRenderCamera(camera_core(intrinsics, engine)),
            parent_frame=self._graph.world_frame_id(),
            X_PC=RigidTransform(X_WC),
        )
        return np.array(image.data[:, :, :3])

    def _depth(self, X_WC: Array, intrinsics: CameraIntrinsics) -> DepthImage:
        core = camera_core(intrinsics, _ENGINE)
        image = self._query.RenderDepthImage(
            camera=DepthRenderCamera(core, DepthRange(NEAR, FAR)),
            parent_frame=self._graph.world_frame_id(),
            X_PC=RigidTransform(X_WC),
        )
        depth = np.array(image.data[:, :, 0])
        depth[~np.isfinite(depth)] = 0.0
        return depth

    def _add_frame(self, name: str) -> Any:
        return self._graph.RegisterFrame(self._source, GeometryFrame(name))

    def _add_props(self, props: Sequence[Prop]) -> None:
        """Adds things that move with the container and have its label."""
        with ScratchFolder() as folder:
            for n, prop in enumerate(props):
                path = folder.path / f"{n}.png"
                _write_png(path, prop.texture)
                self._add(
                    self._frames[0],
                    RigidTransform(prop.X_WP),
                    prop.shape,
                    _CONTAINER_LABEL,
                    {"diffuse": Rgba(1.0, 1.0, 1.0, 1.0), "diffuse_map": str(path)},
                )

    def _add(
        self,
        frame: Any,
        X_FG: RigidTransform,
        shape: Shape,
        label: int,
        material: dict[str, Any],
    ) -> None:
        count = self._graph.model_inspector().num_geometries()
        instance = GeometryInstance(X_FG, shape, f"geometry_{count}")
        properties = PerceptionProperties()
        properties.AddProperty("label", "id", RenderLabel(label))
        for name, value in material.items():
            properties.AddProperty("phong", name, value)
        instance.set_perception_properties(properties)
        self._graph.RegisterGeometry(self._source, frame, instance)


def _params(appearance: Appearance) -> Any:
    params: Any = RenderEngineVtkParams()
    params.lights = [_light(light) for light in appearance.lights]
    params.cast_shadows = appearance.shadows
    params.shadow_map_size = 1024
    params.default_clear_color = np.array(appearance.background)
    return params


def _write_png(path: Path, image: NDArray[np.uint8]) -> None:
    """Writes an RGB image or raises, since VTK ends the process at half an image."""
    _, data = cv2.imencode(".png", np.ascontiguousarray(image[..., ::-1]))
    try:
        path.write_bytes(data.tobytes())
    except OSError as error:
        raise cannot_write(path, error) from error


def _light(light: Light) -> LightParameter:
    return LightParameter(
        type=light.kind,
        color=Rgba(*light.color, 1.0),
        intensity=light.intensity,
        position=np.array(light.position),
        direction=np.array(light.direction),
        frame=light.frame,
        cone_angle=light.cone_angle,
    )
