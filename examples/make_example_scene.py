# SPDX-License-Identifier: MIT
"""Makes the example scene: a small dataset in BOP layout with one image.

    python examples/make_example_scene.py examples/data/tabletop

Puts down a tissue box, a box of crayons on top of it and a bottle beside them. Draws
colour and depth with Drake's RenderEngineVtk. Adds the errors of a depth camera of the
RealSense class. Writes images, camera, true poses, masks and detections.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from pydrake.geometry import (
    Box,
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    GeometryInstance,
    LightParameter,
    MakeRenderEngineVtk,
    Mesh,
    PerceptionProperties,
    RenderCameraCore,
    RenderEngineVtkParams,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo

from physim_drake.camera import CameraIntrinsics
from physim_drake.models import APC11
from physim_drake.objects import ObjectLibrary
from physim_drake.physics.settling import SettleConfig, Settler
from physim_drake.poses import inverse, make_pose
from physim_drake.rendering.depth import DepthRenderer

CAMERA = CameraIntrinsics(640, 480, 615.0, 615.0, 319.5, 239.5)

# Object id, roll, pitch, yaw (deg) and position (m) it is dropped from, and the ids of
# the objects it comes to rest on.
DROPS = (
    (8, (90.0, 0.0, 25.0), (0.0, 0.0, 0.056), ()),
    (1, (0.0, 90.0, -50.0), (-0.006, 0.013, 0.122), (8,)),
    (5, (90.0, 0.0, 0.0), (-0.045, -0.125, 0.071), ()),
)


def main() -> None:
    """Makes the scene in the folder that the command line names."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=3)
    arguments = parser.parse_args()
    library = ObjectLibrary.load(APC11, [drop[0] for drop in DROPS])
    X_WO = settle(library)
    X_WC = look_at(np.array([0.30, -0.38, 0.42]), np.array([0.0, -0.02, 0.05]))
    generator = np.random.default_rng(arguments.seed)
    write_scene(arguments.folder, library, X_WO, X_WC, generator)
    print(f"wrote {arguments.folder}")


def settle(library: ObjectLibrary) -> dict[int, np.ndarray]:
    """World poses (4, 4) of the objects, each come to rest among those before it."""
    config = SettleConfig(max_time=4.0, rest_speed=0.002, damping_time=0.1)
    X_WO: dict[int, np.ndarray] = {}
    for object_id, rpy_deg, p_WO, _ in DROPS:
        others = [library[i] for i in X_WO]
        R_WO = RotationMatrix(RollPitchYaw(np.radians(rpy_deg))).matrix()
        settled = Settler(library[object_id], others, config).settle(
            make_pose(R_WO, p_WO), dict(enumerate(X_WO.values()))
        )
        assert settled.at_rest, f"object {object_id} does not come to rest"
        X_WO[object_id] = settled.X_SO
    return X_WO


def look_at(p_WC: np.ndarray, p_WT: np.ndarray) -> np.ndarray:
    """Camera pose X_WC (4, 4) at `p_WC` that looks at `p_WT`, upright."""
    z = (p_WT - p_WC) / np.linalg.norm(p_WT - p_WC)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    X_WC = np.eye(4)
    X_WC[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    X_WC[:3, 3] = p_WC
    return X_WC


def render(
    library: ObjectLibrary, X_WO: Mapping[int, np.ndarray], X_WC: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Colour (480, 640, 3) uint8 RGB and depth (480, 640) float32 in m, no noise."""
    builder = DiagramBuilder()
    scene_graph: Any = builder.AddSystem(SceneGraph())
    lights = [
        LightParameter(type="point", position=[0.5, -0.6, 1.2], intensity=0.9),
        LightParameter(type="point", position=[-0.8, -0.5, 1.0], intensity=0.45),
    ]
    for light in lights:
        light.frame = "world"
    params = RenderEngineVtkParams(lights=lights, cast_shadows=True)
    scene_graph.AddRenderer("vtk", MakeRenderEngineVtk(params))
    source = scene_graph.RegisterSource("scene")

    def add(
        shape: Any, X: RigidTransform, name: str, color: Rgba | None = None
    ) -> None:
        """Adds a shape at X_WG to what is drawn."""
        instance = GeometryInstance(X, shape, name)
        properties = PerceptionProperties()
        if color is not None:
            properties.AddProperty("phong", "diffuse", color)
        instance.set_perception_properties(properties)
        scene_graph.RegisterAnchoredGeometry(source, instance)

    table = RigidTransform([0.0, 0.0, -0.01])
    add(Box(1.6, 1.2, 0.02), table, "table", Rgba(0.62, 0.58, 0.52, 1.0))
    for object_id, X in X_WO.items():
        add(Mesh(library[object_id].source), RigidTransform(X), str(object_id))
    builder.ExportOutput(scene_graph.get_query_output_port(), "query")
    diagram = builder.Build()
    query: Any = diagram.GetOutputPort("query").Eval(diagram.CreateDefaultContext())
    core = RenderCameraCore(
        "vtk",
        CameraInfo(
            CAMERA.width,
            CAMERA.height,
            CAMERA.fx,
            CAMERA.fy,
            CAMERA.cx + 0.5,
            CAMERA.cy + 0.5,
        ),
        ClippingRange(0.05, 5.0),
        RigidTransform(),
    )
    where = (scene_graph.world_frame_id(), RigidTransform(X_WC))
    color = query.RenderColorImage(ColorRenderCamera(core), *where).data[..., :3]
    camera = DepthRenderCamera(core, DepthRange(0.05, 5.0))
    depth = query.RenderDepthImage(camera, *where).data[..., 0]
    return np.array(color), np.where(np.isfinite(depth), depth, 0.0)


def camera_noise(
    color: np.ndarray, depth: np.ndarray, generator: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """What a depth camera makes of perfect images (our model, after RealSense's).

    Depth errs by 0.7 mm + 1.8 mm z^2, alike in pixels near each other. It is missing at
    steps of the depth and in spots. Colour is a little soft and grainy.
    """
    grain = cv2.GaussianBlur(generator.normal(size=depth.shape), (0, 0), 1.5)
    sigma = 0.0007 + 0.0018 * depth**2
    noisy = depth + sigma * grain / grain.std()
    kernel = np.ones((3, 3), np.uint8)
    step = cv2.dilate(depth, kernel) - cv2.erode(depth, kernel) > 0.02
    spots = cv2.GaussianBlur(generator.normal(size=depth.shape), (0, 0), 3.0)
    edge = cv2.dilate(step.astype(np.uint8), kernel) > 0
    missing = step | (edge & (spots > 0)) | (spots > 3.2 * spots.std())
    soft = cv2.GaussianBlur(color, (0, 0), 0.6).astype(float)
    grainy = soft + generator.normal(scale=2.5, size=color.shape)
    noisy = np.where(missing | (depth == 0), 0.0, noisy)
    return np.clip(grainy, 0, 255).astype(np.uint8), noisy


def write_scene(
    folder: Path,
    library: ObjectLibrary,
    X_WO: Mapping[int, np.ndarray],
    X_WC: np.ndarray,
    generator: np.random.Generator,
) -> None:
    """Writes everything below `folder`."""
    scene = folder / "test" / "000001"
    color, depth = camera_noise(*render(library, X_WO, X_WC), generator)
    write_png(scene / "rgb" / "000000.png", color[..., ::-1])
    write_png(scene / "depth" / "000000.png", np.rint(depth * 1e3).astype(np.uint16))
    X_CW = inverse(X_WC)
    camera = {
        "cam_K": CAMERA.K.ravel().tolist(),
        "depth_scale": 1.0,
        "cam_R_w2c": X_CW[:3, :3].ravel().tolist(),
        "cam_t_w2c": (X_CW[:3, 3] * 1e3).tolist(),
    }
    write_json(scene / "scene_camera.json", {"0": camera})
    X_CO = {i: X_CW @ X for i, X in X_WO.items()}
    silhouettes, visible = masks(library, X_CO)
    truth, info, detections, targets = [], [], [], []
    for n, object_id in enumerate(X_WO):
        mask = visible[object_id]
        write_png(scene / "mask_visib" / f"000000_{n:06d}.png", mask * np.uint8(255))
        truth.append(
            {
                "obj_id": object_id,
                "cam_R_m2c": X_CO[object_id][:3, :3].ravel().tolist(),
                "cam_t_m2c": (X_CO[object_id][:3, 3] * 1e3).tolist(),
            }
        )
        box = bounding_box(mask)
        info.append(
            {
                "bbox_visib": box,
                "px_count_visib": int(mask.sum()),
                "visib_fract": float(mask.sum() / silhouettes[object_id].sum()),
            }
        )
        image = {"scene_id": 1, "image_id": 0, "category_id": object_id}
        detections.append(image | {"bbox": jittered(box, generator), "score": 1.0})
        target = {"scene_id": 1, "im_id": 0, "obj_id": object_id, "inst_count": 1}
        targets.append(target)
    levels = {str(n): 1 + len(drop[3]) for n, drop in enumerate(DROPS)}
    write_json(scene / "scene_gt.json", {"0": truth})
    write_json(scene / "scene_gt_info.json", {"0": info})
    write_json(folder / "detections.json", detections)
    write_json(folder / "test_targets_bop19.json", targets)
    write_json(folder / "levels.json", {"1": {"0": levels}})


def masks(
    library: ObjectLibrary, X_CO: Mapping[int, np.ndarray]
) -> tuple[dict[int, np.ndarray], dict[int, np.ndarray]]:
    """Whole and visible silhouettes (480, 640) bool by object."""
    renderer = DepthRenderer(library, CAMERA)
    depths = {i: renderer.render(i, X) for i, X in X_CO.items()}
    filled = {i: np.where(d > 0, d, np.inf) for i, d in depths.items()}
    nearest = np.min(list(filled.values()), axis=0)
    visible = {i: (d > 0) & (filled[i] <= nearest) for i, d in depths.items()}
    return {i: d > 0 for i, d in depths.items()}, visible


def bounding_box(mask: np.ndarray) -> list[int]:
    """Left, top, width, height of a mask, px."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    left, top = int(columns[0]), int(rows[0])
    return [left, top, int(columns[-1]) - left + 1, int(rows[-1]) - top + 1]


def jittered(box: list[int], generator: np.random.Generator) -> list[float]:
    """The box with each side off by up to 3 % of its size, as a detector's would be."""
    left, top, width, height = box
    shift = generator.uniform(-0.03, 0.03, 4) * [width, height, width, height]
    corners = np.array([left, top, left + width, top + height]) + shift
    x0, y0, x1, y1 = np.round(corners, 1).tolist()
    return [x0, y0, round(x1 - x0, 1), round(y1 - y0, 1)]


def write_png(path: Path, image: np.ndarray) -> None:
    """Writes an image, colour as blue, green, red."""
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), image, [cv2.IMWRITE_PNG_COMPRESSION, 9])


def write_json(path: Path, value: Any) -> None:
    """Writes JSON, with one entry a line if it is a list."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(value, list):
        text = "[\n" + ",\n".join(json.dumps(entry) for entry in value) + "\n]\n"
    else:
        text = json.dumps(value) + "\n"
    path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
