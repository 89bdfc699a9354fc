# SPDX-License-Identifier: MIT
"""Writes datasets in BOP layout: models, and one scene with its images at a time.

The layout is that of `physim_drake.datasets.bop`. Millimetres and "R, t" begin here.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physim_drake.camera import CameraIntrinsics
from physim_drake.datasets.bop import mask_bounds
from physim_drake.objects.meshes import posed_raw_mesh
from physim_drake.objects.model import ObjectLibrary, ObjectModel
from physim_drake.observation.observation import Mask, RgbdObservation
from physim_drake.poses import Array, inverse

DEPTH_SCALE = 0.1
"""Millimetres per unit of the depth images."""


@dataclass(frozen=True)
class BopImage:
    """One image with its ground truth.

    Attributes:
        observation: the image; its X_WC must be known.
        object_ids: ids of the objects in it.
        X_CO: their poses in the camera, (N, 4, 4), m.
        silhouettes: masks of the objects without occlusion, (N, height, width).
        visible: masks of their visible parts, (N, height, width).
    """

    observation: RgbdObservation
    object_ids: Sequence[int]
    X_CO: Array
    silhouettes: NDArray[np.bool_]
    visible: NDArray[np.bool_]


def write_bop_scene(
    folder: Path, images: Sequence[BopImage], names: Mapping[int, str]
) -> None:
    """Writes a scene: images, masks, cameras, ground truth, COCO annotations.

    Args:
        folder: folder of the scene, which is made.
        images: images of the scene; their ids count from 0.
        names: name of each object by its id.

    Raises:
        OSError: if a file cannot be written.
    """
    for name in ("rgb", "depth", "mask", "mask_visib"):
        (folder / name).mkdir(parents=True)
    cameras, poses, infos = {}, {}, {}
    for im_id, image in enumerate(images):
        _write_images(folder, im_id, image)
        cameras[str(im_id)] = _camera_entry(image.observation)
        poses[str(im_id)] = [
            {"obj_id": object_id, **_pose_entry(X, "cam_R_m2c", "cam_t_m2c")}
            for object_id, X in zip(image.object_ids, image.X_CO, strict=True)
        ]
        infos[str(im_id)] = [
            _info_entry(silhouette, visible, image.observation)
            for silhouette, visible in zip(
                image.silhouettes, image.visible, strict=True
            )
        ]
    write_json(folder / "scene_camera.json", cameras)
    write_json(folder / "scene_gt.json", poses)
    write_json(folder / "scene_gt_info.json", infos)
    write_json(folder / "scene_gt_coco.json", _coco(images, names))


def write_bop_models(folder: Path, library: ObjectLibrary) -> None:
    """Writes PLY models in millimetres, their textures and `models_info.json`.

    Args:
        folder: folder of the models; it is made, unless it exists and is empty.
        library: models of the objects.

    Raises:
        OSError: if a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    infos = {}
    for object_id, model in library.items():
        _write_ply(folder, f"obj_{object_id:06d}", model)
        infos[str(object_id)] = _model_info(model)
    write_json(folder / "models_info.json", infos)


def write_json(path: Path, value: Any) -> None:
    """Writes `json_text`; raises `OSError` if that fails."""
    path.write_text(json_text(value), encoding="utf-8")


def json_text(value: Any) -> str:
    """JSON with a line for each member of the outermost value."""
    if isinstance(value, dict):
        items = [f"{json.dumps(k)}: {_compact(v)}" for k, v in value.items()]
        return "{\n" + ",\n".join(items) + "\n}\n"
    return "[\n" + ",\n".join(_compact(v) for v in value) + "\n]\n"


def _compact(value: Any) -> str:
    return json.dumps(value, allow_nan=False)


def _write_images(folder: Path, im_id: int, image: BopImage) -> None:
    name = f"{im_id:06d}.png"
    observation = image.observation
    depth = np.round(observation.depth.astype(float) * 1e3 / DEPTH_SCALE)
    limit = np.iinfo(np.uint16).max
    depth[depth > limit] = 0  # too far for the file format: not measured
    write_image(folder / "depth" / name, depth.astype(np.uint16))
    if observation.color is not None:
        write_image(folder / "rgb" / name, observation.color[..., ::-1])
    for kind, masks in (("mask", image.silhouettes), ("mask_visib", image.visible)):
        for k, mask in enumerate(masks):
            path = folder / kind / f"{im_id:06d}_{k:06d}.png"
            write_image(path, mask.astype(np.uint8) * 255)


def write_image(path: Path, image: NDArray[Any]) -> None:
    """Writes a PNG; raises `OSError` if that fails."""
    done, data = cv2.imencode(".png", image)
    assert done, "PNG takes 8 and 16 bit"
    path.write_bytes(data.tobytes())


def _pose_entry(X: Array, rotation: str, translation: str) -> dict[str, list[float]]:
    return {
        rotation: [round(float(x), 9) for x in X[:3, :3].ravel()],
        translation: [round(float(x) * 1e3, 6) for x in X[:3, 3]],
    }


def _camera_entry(observation: RgbdObservation) -> dict[str, Any]:
    assert observation.X_WC is not None, "the camera pose is part of the ground truth"
    X_CW = inverse(observation.X_WC)
    return {
        "cam_K": [float(x) for x in observation.intrinsics.K.ravel()],
        "depth_scale": DEPTH_SCALE,
        **_pose_entry(X_CW, "cam_R_w2c", "cam_t_w2c"),
    }


def _info_entry(
    silhouette: Mask, visible: Mask, observation: RgbdObservation
) -> dict[str, Any]:
    count = int(silhouette.sum())
    return {
        "bbox_obj": _bbox(silhouette),
        "bbox_visib": _bbox(visible),
        "px_count_all": count,
        "px_count_valid": int((silhouette & (observation.depth > 0)).sum()),
        "px_count_visib": int(visible.sum()),
        "visib_fract": round(int(visible.sum()) / max(count, 1), 6),
    }


def _bbox(mask: Mask) -> list[int]:
    """Left, top, width and height; all -1 if the mask is empty, as in BOP."""
    if not mask.any():
        return [-1, -1, -1, -1]
    left, top, right, bottom = (int(x) for x in mask_bounds(mask))
    return [left, top, right - left, bottom - top]


def _coco(images: Sequence[BopImage], names: Mapping[int, str]) -> dict[str, Any]:
    """COCO annotations of the visible masks (bop_toolkit, calc_gt_coco.py)."""
    entries: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for im_id, image in enumerate(images):
        camera: CameraIntrinsics = image.observation.intrinsics
        size = {"width": camera.width, "height": camera.height}
        entries.append({"id": im_id, "file_name": f"rgb/{im_id:06d}.png", **size})
        for object_id, mask in zip(image.object_ids, image.visible, strict=True):
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": im_id,
                    "category_id": object_id,
                    "iscrowd": 0,
                    "area": int(mask.sum()),
                    "bbox": _bbox(mask),
                    "segmentation": {
                        "size": [camera.height, camera.width],
                        "counts": _runs(mask),
                    },
                    **size,
                    "ignore": False,
                }
            )
    categories = [
        {"id": object_id, "name": name, "supercategory": "object"}
        for object_id, name in sorted(names.items())
    ]
    return {"images": entries, "annotations": annotations, "categories": categories}


def _runs(mask: Mask) -> list[int]:
    """COCO's uncompressed runs: down the columns, first of zeros."""
    flat = mask.ravel(order="F")
    changes = np.flatnonzero(np.diff(flat)) + 1
    runs = np.diff(np.concatenate([[0], changes, [flat.size]])).tolist()
    return [0, *runs] if flat[0] else runs


def _model_info(model: ObjectModel) -> dict[str, Any]:
    low, high = model.mesh.bounds * 1e3
    info: dict[str, Any] = {"diameter": round(model.diameter * 1e3, 6)}
    for k, axis in enumerate("xyz"):
        info[f"min_{axis}"] = round(float(low[k]), 6)
        info[f"size_{axis}"] = round(float(high[k] - low[k]), 6)
    discrete = model.symmetry.discrete[1:].copy()
    discrete[:, :3, 3] *= 1e3
    # Present even if empty: it says that the symmetries are known.
    info["symmetries_discrete"] = [
        [round(float(x), 9) for x in X.ravel()] for X in discrete
    ]
    info["symmetries_continuous"] = [
        {
            "axis": [round(float(x), 9) for x in axis.axis],
            "offset": [round(float(x) * 1e3, 6) for x in axis.point],
        }
        for axis in model.symmetry.axes
    ]
    return info


def _write_ply(folder: Path, stem: str, model: ObjectModel) -> None:
    """Writes an ASCII PLY with normals and, if there is one, its texture."""
    header = ["ply", "format ascii 1.0"]
    names = ["x", "y", "z", "nx", "ny", "nz"]
    mesh, unit, uv = model.mesh, 1.0, None
    if model.texture is not None:
        # The merged mesh of the model has lost the seams of the texture.
        raw = posed_raw_mesh(model.source, model.source_unit, model.source_pose)
        uv = getattr(raw.visual, "uv", None)
        image = cv2.imread(str(model.texture), cv2.IMREAD_COLOR)
        if uv is not None and image is not None:
            mesh, unit = raw, model.source_unit
            header.append(f"comment TextureFile {stem}.png")
            names += ["texture_u", "texture_v"]
            write_image(folder / f"{stem}.png", image)
        else:
            uv = None
    columns = [np.asarray(mesh.vertices) * unit * 1e3, np.asarray(mesh.vertex_normals)]
    if uv is not None:
        columns.append(np.asarray(uv))
    rows = np.concatenate(columns, axis=1)
    header.append(f"element vertex {len(rows)}")
    header += [f"property float {name}" for name in names]
    header.append(f"element face {len(mesh.faces)}")
    header += ["property list uchar int vertex_indices", "end_header"]
    lines = [" ".join(f"{x:.7g}" for x in row) for row in rows]
    lines += ["3 {} {} {}".format(*face) for face in np.asarray(mesh.faces)]
    text = "\n".join([*header, *lines]) + "\n"
    (folder / f"{stem}.ply").write_text(text, encoding="utf-8")
