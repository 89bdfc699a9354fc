# SPDX-License-Identifier: MIT
"""The images of a dataset as arrays on disk, quick to draw from at random.

Decoding PNG files again and again would cost a good part of the training time. They
are decoded once, reduced, and kept as plain NumPy arrays that are mapped into memory.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physim_drake.camera import CameraIntrinsics
from physim_drake.datasets.bop import BopDataset, ImageId
from physim_drake.errors import InputError
from physim_drake.observation.observation import Detection
from physim_drake.storage.files import cannot_write, make_folder
from physim_drake.storage.json_nodes import read_json

_NOTES = "images.json"
_DEPTH_UNIT = 1e-4  # m

Progress = Callable[[int], None]


@dataclass(frozen=True)
class LabelledImage:
    """An image and the objects in it.

    Attributes:
        color: (height, width, 3) uint8 RGB.
        labels: (height, width) uint8, k if the k-th object is seen, else 0.
        object_ids: ids of the objects.
        depth: (height, width) float32, m, 0 if not measured, or None.
    """

    color: NDArray[np.uint8]
    labels: NDArray[np.uint8]
    object_ids: tuple[int, ...]
    depth: NDArray[np.float32] | None = None


class TrainingImages:
    """The packed images of a dataset.

    Args:
        folder: folder that `pack_images` wrote.

    Raises:
        InputError: if a file is missing or damaged.
    """

    def __init__(self, folder: Path) -> None:
        notes = read_json(folder / _NOTES).value
        self._object_ids: list[list[int]] = notes["object_ids"]
        try:
            self._color = np.load(folder / "color.npy", mmap_mode="r")
            self._labels = np.load(folder / "labels.npy", mmap_mode="r")
            self._depth = None
            if (folder / "depth.npy").exists():
                self._depth = np.load(folder / "depth.npy", mmap_mode="r")
        except (OSError, ValueError) as error:  # one is missing, or cut short
            raise InputError(
                folder, f"cannot be used ({error})", "remove it, and --resume"
            ) from error

    def __len__(self) -> int:
        return len(self._object_ids)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the images, px."""
        height, width = self._labels.shape[1:]
        return height, width

    @property
    def object_ids(self) -> set[int]:
        """The objects that are seen in any image."""
        return {i for ids in self._object_ids for i in ids}

    def __getitem__(self, index: int) -> LabelledImage:
        depth = None
        if self._depth is not None:
            depth = self._depth[index].astype(np.float32) * np.float32(_DEPTH_UNIT)
        return LabelledImage(
            np.array(self._color[index]),
            np.array(self._labels[index]),
            tuple(self._object_ids[index]),
            depth,
        )


class MixedImages:
    """Several sets of images as one, in which each counts the same.

    Image n belongs to set n modulo the number of sets, so that the images of a small
    set come several times.

    Args:
        sets: one or more sets, each with images.
    """

    def __init__(self, sets: Sequence[TrainingImages]) -> None:
        self._sets = tuple(sets)

    def __len__(self) -> int:
        return len(self._sets) * max(len(images) for images in self._sets)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the images of the first set, px."""
        return self._sets[0].size

    @property
    def object_ids(self) -> set[int]:
        """The objects that are seen in any image."""
        return set().union(*(images.object_ids for images in self._sets))

    def __getitem__(self, index: int) -> LabelledImage:
        images = self._sets[index % len(self._sets)]
        return images[index // len(self._sets) % len(images)]


def pack_images(
    dataset: BopDataset,
    folder: Path,
    longer_side: int,
    depth: bool,
    progress: Progress = lambda done: None,
    known: Collection[int] | None = None,
) -> TrainingImages:
    """Reduces the images of a dataset and writes them as arrays, unless they are there.

    Args:
        dataset: dataset with visible masks and images of one size.
        folder: folder for the arrays. Arrays of other images are replaced.
        longer_side: longer side of the reduced images, px.
        depth: whether to pack depth as well.
        progress: callback for the number of images done.
        known: ids of the objects that may be seen. None allows any.

    Raises:
        InputError: if the dataset has no image, or shows no object or an unknown one,
            if its files cannot be used, or if the arrays cannot be written.
    """
    origin = {
        # Relative, so that a run in another folder writes the same.
        "dataset": os.path.relpath(dataset.root.resolve(), folder.resolve()),
        "split": dataset.split,
        "longer_side": longer_side,
        "depth": depth,
        "known": None if known is None else sorted(known),
    }
    if _origin(folder) != origin:
        scratch = folder.with_name(f".{folder.name}.tmp")
        shutil.rmtree(scratch, ignore_errors=True)
        make_folder(scratch)
        try:
            object_ids = _write(dataset, scratch, longer_side, depth, progress)
            _check_objects(dataset, {i for ids in object_ids for i in ids}, known)
            notes = {"origin": origin, "object_ids": object_ids}
            (scratch / _NOTES).write_text(json.dumps(notes))
            shutil.rmtree(folder, ignore_errors=True)
            scratch.rename(folder)
        except OSError as error:
            raise cannot_write(folder, error) from error
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
    return TrainingImages(folder)


def _origin(folder: Path) -> Any:
    """What the arrays in a folder were made from. None if there are no arrays."""
    path = folder / _NOTES
    origin = read_json(path).get("origin") if path.exists() else None
    return None if origin is None else origin.value


def _check_objects(
    dataset: BopDataset, shown: set[int], known: Collection[int] | None
) -> None:
    if not shown:
        raise InputError(dataset.root, "shows no object", "give images with masks")
    if known is not None and (strangers := sorted(shown.difference(known))):
        raise InputError(
            dataset.root,
            f"shows object {strangers[0]}, which has no model",
            "give the models that belong to the data",
        )


def _write(
    dataset: BopDataset,
    folder: Path,
    longer_side: int,
    depth: bool,
    progress: Progress,
) -> list[list[int]]:
    """Writes the arrays and returns the objects in each image."""
    images = dataset.images()
    if not images:
        raise InputError(dataset.root, "holds no image", "generate some")
    camera = dataset.intrinsics(*images[0])
    factor = min(longer_side / max(camera.width, camera.height), 1.0)
    size = (round(camera.width * factor), round(camera.height * factor))
    shape = (len(images), size[1], size[0])
    kinds: dict[str, tuple[tuple[int, ...], type[np.generic]]] = {
        "color": ((*shape, 3), np.uint8),
        "labels": (shape, np.uint8),
    }
    if depth:
        kinds["depth"] = (shape, np.uint16)
    object_ids = []
    with ExitStack() as stack:
        files = {
            name: stack.enter_context(_array_file(folder / f"{name}.npy", *kind))
            for name, kind in kinds.items()
        }
        for n, image in enumerate(images):
            arrays, ids = _reduced_image(dataset, image, camera, size)
            for name, file in files.items():
                file.write(arrays[name].tobytes())
            object_ids.append(ids)
            progress(n + 1)
    return object_ids


def _reduced_image(
    dataset: BopDataset, image: ImageId, camera: CameraIntrinsics, size: tuple[int, int]
) -> tuple[dict[str, NDArray[Any]], list[int]]:
    """The arrays of an image by name, and the objects in it."""
    observation, objects = dataset.observation(*image), dataset.masks(*image)
    shape = observation.depth.shape
    if observation.color is None or shape != (camera.height, camera.width):
        raise InputError(
            observation.name,
            "has no colour, or another size than the first image",
            "generate the data again",
        )
    units = np.round(_reduced(observation.depth, size) / _DEPTH_UNIT)
    arrays = {
        "color": cv2.resize(observation.color, size, interpolation=cv2.INTER_AREA),
        "labels": _reduced(label_map(objects, shape=shape), size),
        "depth": np.minimum(units, np.iinfo(np.uint16).max).astype(np.uint16),
    }
    return arrays, [d.object_id for d in objects]


@contextmanager
def _array_file(
    path: Path, shape: tuple[int, ...], kind: type[np.generic]
) -> Iterator[IO[bytes]]:
    """A .npy file to write the values of an array to, one after the other.

    Not a mapped array: if the disk is full, writing to one kills the process.
    """
    with path.open("wb") as file:
        header = {
            "descr": np.lib.format.dtype_to_descr(np.dtype(kind)),
            "fortran_order": False,
            "shape": shape,
        }
        np.lib.format.write_array_header_1_0(file, header)
        yield file


def _reduced(image: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_NEAREST_EXACT))


def label_map(
    objects: Sequence[Detection], shape: tuple[int, ...]
) -> NDArray[np.uint8]:
    """Which of up to 255 objects with masks is seen in each pixel, from 1."""
    labels = np.zeros(shape, np.uint8)
    for k, detection in enumerate(objects, start=1):
        labels[detection.pixels(*shape)] = k
    return labels
