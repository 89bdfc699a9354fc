# SPDX-License-Identifier: MIT
"""Depth images of single objects, rendered with Drake's RenderEngineVtk.

The search draws one object at a time and composites, so each object stands alone in
its own corner of the renderer's world and the camera is what moves.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.geometry import (
    DepthRange,
    DepthRenderCamera,
    GeometryInstance,
    MakeRenderEngineVtk,
    PerceptionProperties,
    RenderEngineVtkParams,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from physim_drake.camera import CameraIntrinsics, DepthImage
from physim_drake.objects.drake_shapes import mesh_shape
from physim_drake.objects.model import ObjectModel
from physim_drake.poses import Array, inverse
from physim_drake.rendering.camera_core import FAR, NEAR, camera_core
from physim_drake.rendering.windows import DepthWindow, crop

_SPACING = 25.0
_ENGINE = "vtk"


class DepthRenderer:
    """Renders depth images of one object at a time.

    Args:
        models: models of the objects, by id.
        intrinsics: intrinsics of the camera.

    A renderer holds an OpenGL context. Make one in each process and keep it.
    """

    def __init__(
        self, models: Mapping[int, ObjectModel], intrinsics: CameraIntrinsics
    ) -> None:
        self.intrinsics = intrinsics
        self._camera = _depth_camera(intrinsics)
        builder = DiagramBuilder()
        scene_graph: SceneGraph = builder.AddSystem(SceneGraph())  # type: ignore[assignment]
        scene_graph.AddRenderer(_ENGINE, MakeRenderEngineVtk(RenderEngineVtkParams()))
        source = scene_graph.RegisterSource("objects")
        self._X_WO = {}
        for n, (object_id, model) in enumerate(models.items()):
            p_WO = _SPACING * np.array([n % 16, n // 16 % 16, n // 256])
            self._X_WO[object_id] = RigidTransform(p_WO)
            instance = GeometryInstance(
                RigidTransform(p_WO), mesh_shape(model.mesh, model.name), str(object_id)
            )
            properties = PerceptionProperties()
            properties.AddProperty("phong", "diffuse", Rgba(0.7, 0.7, 0.7, 1.0))
            instance.set_perception_properties(properties)
            scene_graph.RegisterAnchoredGeometry(source, instance)
        builder.ExportOutput(scene_graph.get_query_output_port(), "query")
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._query: Any = self._diagram.GetOutputPort("query").Eval(self._context)
        self._world = scene_graph.world_frame_id()

    def render(self, object_id: int, X_CO: Array) -> DepthImage:
        """Renders the object alone.

        Args:
            object_id: id of the object.
            X_CO: pose of the object in the camera, (4, 4).

        Returns:
            Depth z, m, (height, width) float32, 0 beside the object.
        """
        X_OC = RigidTransform(inverse(X_CO))
        image = self._query.RenderDepthImage(
            camera=self._camera,
            parent_frame=self._world,
            X_PC=self._X_WO[object_id] @ X_OC,
        )
        depth = np.array(image.data[:, :, 0])
        depth[~np.isfinite(depth)] = 0.0
        return depth

    def window(self, object_id: int, X_CO: Array) -> DepthWindow:
        """The part of `render`'s image that shows the object."""
        return crop(self.render(object_id, X_CO))


def _depth_camera(intrinsics: CameraIntrinsics) -> DepthRenderCamera:
    return DepthRenderCamera(camera_core(intrinsics, _ENGINE), DepthRange(NEAR, FAR))
