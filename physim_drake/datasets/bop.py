# SPDX-License-Identifier: MIT
"""Reads datasets in BOP layout.

The layout is the one of the BOP challenge (Hodan et al., "BOP: Benchmark for 6D Object
Pose Estimation", ECCV 2018; bop_toolkit/docs/bop_datasets_format.md). Millimetres and
"R, t" end here: everything that leaves this module is in metres and poses.
"""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from physim_drake.camera import CameraIntrinsics
from physim_drake.datasets.images import png_size, read_color, read_depth, read_mask
from physim_drake.datasets.scene_files import (
    SceneFiles,
    read_camera_pose,
    read_intrinsics,
    read_pose,
)
from physim_drake.errors import InputError
from physim_drake.objects.library_files import find_objects
from physim_drake.observation.observation import Detection, Mask, RgbdObservation
from physim_drake.poses import Array
from physim_drake.storage.json_nodes import read_json

ImageId = tuple[int, int]
"""Scene id and image id."""

LEAST_VISIBLE = 0.1
"""Visible share of an object's silhouette from which it is a target, as in BOP."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Target:
    """An object to find in an image, and the number of its instances."""

    scene_id: int
    im_id: int
    object_id: int
    count: int


@dataclass(frozen=True)
class GroundTruthPose:
    """The true pose of an object in an image.

    Attributes:
        object_id: id of the object.
        X_CO: its pose in the camera, (4, 4), m.
        visible_fraction: visible share of its silhouette, 0..1, or None if it is not
            given.
        level: interaction level (levels.json), or None if it is not given.
    """

    object_id: int
    X_CO: Array
    visible_fraction: float | None = None
    level: int | None = None


class BopDataset:
    """A dataset in BOP layout; files are read when they are needed.

    Every method raises `InputError` naming the file and field that cannot be used.

    Args:
        root: folder of the dataset.
        split: folder of the images below `root`, a plain name.
        models: folder of the object models; ``root/models`` if it is None.

    Attributes:
        root: folder of the dataset.
        split: name of the folder of the images.
        models: folder of the object models.
    """

    def __init__(
        self,
        root: str | Path,
        split: str = "test",
        models: str | Path | None = None,
    ) -> None:
        root = Path(root)
        if not re.fullmatch(r"\w[\w.-]*", split, re.ASCII):
            raise InputError(
                root, f"split {split!r}", "name a folder below the dataset, as in test"
            )
        self.root, self.split = root, split
        self.models = root / "models" if models is None else Path(models)
        self._scenes: dict[int, SceneFiles] = {}
        self._detections: Mapping[ImageId, list[Detection]] | None = None
        if not (root / split).is_dir():
            raise InputError(
                root,
                f'has no folder "{split}"',
                "give the root of a dataset in BOP layout, or another split",
            )

    def images(self) -> list[ImageId]:
        """All images, in ascending order."""
        names = (path.name for path in (self.root / self.split).iterdir())
        scene_ids = sorted(int(n) for n in names if re.fullmatch(r"[0-9]{6}", n))
        if not scene_ids:
            raise InputError(
                self.root / self.split,
                "holds no scene",
                "scenes are folders named by six digits, as in 000001",
            )
        return [(s, im) for s in scene_ids for im in self._scene(s).cameras]

    def intrinsics(self, scene_id: int, im_id: int) -> CameraIntrinsics:
        """The camera of an image; only the heads of image files are read."""
        scene = self._scene(scene_id)
        return read_intrinsics(scene.camera(im_id), *png_size(scene.depth_path(im_id)))

    def observation(self, scene_id: int, im_id: int) -> RgbdObservation:
        """One image with its camera; depth in m, X_WC if the dataset gives it."""
        scene = self._scene(scene_id)
        camera, depth_path = scene.camera(im_id), scene.depth_path(im_id)
        color_path = scene.color_path(im_id)
        raw = read_depth(depth_path)
        scale = camera["depth_scale"].number(minimum=1e-6, maximum=1e3)
        sources = {
            "depth": depth_path,
            "color": color_path or depth_path,
            "intrinsics": scene.camera_path,
            "X_WC": scene.camera_path,
        }
        try:
            return RgbdObservation(
                depth=raw.astype(np.float32) * np.float32(scale * 1e-3),
                intrinsics=read_intrinsics(camera, raw.shape[1], raw.shape[0]),
                color=read_color(color_path) if color_path else None,
                X_WC=read_camera_pose(camera),
                name=f"{self.root.name}/{scene_id}/{im_id}",
            )
        except InputError as error:
            if error.field not in sources:
                raise
            # The observation knows the field, but the user needs the file as well.
            raise InputError(
                sources[error.field], error.problem, error.remedy, error.field
            ) from None

    def detections(self, scene_id: int, im_id: int) -> list[Detection]:
        """The detections of an image in the dataset's own detections.json.

        `load_detections` reads other files, and many images at once.
        """
        from physim_drake.datasets.detections import load_detections

        path = self.root / "detections.json"
        if self._detections is None:
            self._detections = load_detections(path, self)
        return self._detections.get((scene_id, im_id), [])

    def targets(
        self, path: str | Path | None = None, images: Collection[ImageId] = ()
    ) -> list[Target]:
        """The objects to find: from a file, or else from the ground truth.

        A target in an image that the dataset does not have is left out, with a
        warning. Targets from the ground truth are the objects that have a model and
        of which at least a tenth is visible.

        Args:
            path: targets file. If it is None, the dataset's test_targets_bop19.json
                is read; if there is no such file, the targets are those of every
                scene_gt.json.
            images: images to look at; all if empty. Files of other images are not
                read.
        """
        own = self.root / "test_targets_bop19.json"
        if path is None and not own.exists():
            return self._targets_from_ground_truth(images)
        targets: list[Target] = []
        left_out: list[InputError] = []
        seen: set[tuple[int, int, int]] = set()
        for node in read_json(Path(path or own)).elements():
            target = Target(
                node["scene_id"].integer(),
                node["im_id"].integer(),
                node["obj_id"].integer(),
                node["inst_count"].integer(minimum=1, maximum=10_000),
            )
            key = (target.scene_id, target.im_id, target.object_id)
            if key in seen:
                node.fail(f"lists object {key[2]} of image {key[:2]} again", "merge")
            seen.add(key)
            image = (target.scene_id, target.im_id)
            try:
                if not (images and image not in images) and not self.has_image(*image):
                    node.fail(
                        f"names image {target.im_id} of scene {target.scene_id}, "
                        f'which is not in "{self.split}"',
                        "remove the target, or get the image",
                    )
            except InputError as error:
                left_out.append(error)
            else:
                targets.append(target)
        if left_out and not targets:
            raise left_out[0]
        if left_out:
            _log.warning("targets left out: %d, first: %s", len(left_out), left_out[0])
        return targets

    def has_image(self, scene_id: int, im_id: int) -> bool:
        """Whether scene_camera.json of the scene lists the image."""
        folder = self._scene_folder(scene_id)
        return folder.is_dir() and im_id in self._scene(scene_id).cameras

    def ground_truth(self, scene_id: int, im_id: int) -> list[GroundTruthPose]:
        """The true poses in the order of scene_gt.json; empty without ground truth."""
        scene = self._scene(scene_id)
        scene.camera(im_id)
        if im_id not in scene.ground_truth:
            return []
        info = scene.ground_truth_info.get(im_id)
        infos = list(info.elements()) if info is not None else []
        levels = self._levels.get((scene_id, im_id), {})
        poses = []
        for index, node in enumerate(scene.ground_truth[im_id].elements()):
            fraction = infos[index].get("visib_fract") if index < len(infos) else None
            poses.append(
                GroundTruthPose(
                    node["obj_id"].integer(),
                    read_pose(node, "cam_R_m2c", "cam_t_m2c"),
                    None if fraction is None else fraction.number(0.0, 1.0),
                    levels.get(index),
                )
            )
        return poses

    def masks(self, scene_id: int, im_id: int) -> list[Detection]:
        """The visible masks (mask_visib) as detections of score 1.

        Mask k shows object k of scene_gt.json. If the image has no ground truth, it
        shows the k-th detection of the image in the dataset's detections.json. If
        there is no such file either, it shows the k-th instance of the targets, in
        their order. Empty masks are left out.
        """
        scene = self._scene(scene_id)
        size = png_size(scene.depth_path(im_id))
        detections = []
        for index, object_id in enumerate(self._mask_objects(scene_id, im_id)):
            path = scene.folder / "mask_visib" / f"{im_id:06d}_{index:06d}.png"
            mask = read_mask(path)
            if mask.shape != (size[1], size[0]):
                raise InputError(
                    path,
                    f"is {mask.shape[1]} x {mask.shape[0]}, depth {size[0]} x "
                    f"{size[1]} pixels",
                    "masks must have the size of the depth image",
                )
            if mask.any():
                detections.append(Detection(object_id, mask_bounds(mask), mask=mask))
        return detections

    def _mask_objects(self, scene_id: int, im_id: int) -> list[int]:
        """Id of the object that each mask of an image shows."""
        if poses := self.ground_truth(scene_id, im_id):
            return [pose.object_id for pose in poses]
        path = self.root / "detections.json"
        if path.exists():
            return [
                node["category_id"].integer()
                for node in read_json(path).elements()
                if node["scene_id"].integer() == scene_id
                and node["image_id"].integer() == im_id
            ]
        return [
            target.object_id
            for target in self.targets()
            if (target.scene_id, target.im_id) == (scene_id, im_id)
            for _ in range(target.count)
        ]

    def _targets_from_ground_truth(self, images: Collection[ImageId]) -> list[Target]:
        targets = []
        for scene_id, im_id in images or self.images():
            poses = self.ground_truth(scene_id, im_id)
            counts = Counter(pose.object_id for pose in poses if _is_visible(pose))
            targets += [Target(scene_id, im_id, o, n) for o, n in counts.items()]
        targets = self._with_models(targets)
        if not targets:
            raise InputError(
                self.root,
                "has no test_targets_bop19.json, and no scene_gt.json with a visible "
                "object that has a model",
                "give a targets file",
            )
        return targets

    def _with_models(self, targets: list[Target]) -> list[Target]:
        """The targets that have models; all of them if there is no models folder."""
        if not self.models.is_dir():
            return targets
        known = {entry.object_id for entry in find_objects(self.models)}
        unknown = sorted({t.object_id for t in targets} - known)
        if unknown:
            ids = ", ".join(map(str, unknown))
            _log.warning("%s: has no model of obj_id %s, left out", self.models, ids)
        return [t for t in targets if t.object_id in known]

    @cached_property
    def _levels(self) -> dict[ImageId, dict[int, int]]:
        """Interaction levels by image, then by index in scene_gt.json."""
        path = self.root / "levels.json"
        if not path.exists():
            return {}
        return {
            (scene_id, im_id): {
                index: level.integer(minimum=1)
                for index, level in image.by_id().items()
            }
            for scene_id, scene in read_json(path).by_id().items()
            for im_id, image in scene.by_id().items()
        }

    def _scene_folder(self, scene_id: int) -> Path:
        return self.root / self.split / f"{scene_id:06d}"

    def _scene(self, scene_id: int) -> SceneFiles:
        if scene_id not in self._scenes:
            self._scenes[scene_id] = SceneFiles(self._scene_folder(scene_id))
        return self._scenes[scene_id]


def _is_visible(pose: GroundTruthPose) -> bool:
    """Whether enough shows of an object to be a target; it does if it is not said."""
    return pose.visible_fraction is None or pose.visible_fraction >= LEAST_VISIBLE


def mask_bounds(mask: Mask) -> Array:
    """Left, top, right, bottom (exclusive) of a mask with at least one pixel, px."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], dtype=float)


def image_ids(targets: list[Target]) -> Iterator[ImageId]:
    """The images of `targets`, each once, in their order."""
    yield from dict.fromkeys((t.scene_id, t.im_id) for t in targets)
