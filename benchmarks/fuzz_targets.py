# SPDX-License-Identifier: MIT
"""Targets that feed each reader one file of arbitrary bytes among valid files.

A target takes bytes. The first chooses the file that the others become. A target
catches `PhysimError`, all that readers may raise, and lets everything else through.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import trimesh
from PIL import Image

from physim_drake.datasets import bop, detections, images, results, rle
from physim_drake.datasets.results_writer import ResultsWriter
from physim_drake.errors import PhysimError
from physim_drake.storage import json_nodes

if TYPE_CHECKING:
    from physim_drake.detection.training.checkpoints import TrainingState

WIDTH, HEIGHT = 12, 8
TURN = [0, -1, 0, 1, 0, 0, 0, 0, 1]
IMAGE = {"scene_id": 3, "image_id": 0, "category_id": 1, "score": 0.5}
SEGMENTATION = {"size": [HEIGHT, WIDTH], "counts": "0000h3"}


@dataclass(frozen=True)
class Target:
    """A set of readers.

    Attributes:
        seeds: inputs with valid files, to begin from.
        read: function that reads an input and catches only `PhysimError`.
    """

    seeds: tuple[bytes, ...]
    read: Callable[[bytes], None]


def _files_target(
    folder: Path, names: list[str], read: Callable[[Path], None]
) -> Target:
    """A target whose input replaces one of the files `names` in a folder."""
    valid = [(folder / name).read_bytes() for name in names]

    def read_input(data: bytes) -> None:
        """Reads the folder with one file exchanged, then puts the file back."""
        path = folder / names[data[0] % len(names)] if data else None
        if path is None:
            return
        path.write_bytes(data[1:])
        try:
            read(path)
        finally:
            path.write_bytes(valid[names.index(str(path.relative_to(folder)))])

    return Target(tuple(bytes([k]) + v for k, v in enumerate(valid)), read_input)


@contextmanager
def only_physim_errors() -> Iterator[None]:
    """Catches errors that users can remedy. Anything else is a defect."""
    with suppress(PhysimError):
        yield


def bop_target(folder: Path) -> Target:
    """The JSON files of a dataset in BOP layout, and detections."""
    names = _write_bop(folder)

    def read(path: Path) -> None:
        """Asks the dataset for everything, whichever file it is."""
        dataset = bop.BopDataset(folder)
        for ask in (
            dataset.images,
            dataset.targets,
            lambda: dataset._targets_from_ground_truth(()),
            lambda: dataset.intrinsics(3, 0),
            lambda: dataset.ground_truth(3, 0),
            lambda: dataset.masks(3, 0),
            lambda: dataset.observation(3, 0),
            lambda: detections.load_detections(folder / "detections.json", dataset)[
                3, 0
            ],
        ):
            with only_physim_errors():
                ask()

    return _files_target(folder, names, read)


def _write_bop(folder: Path) -> list[str]:
    """Writes a dataset of one image and returns the names of its JSON files."""
    scene = folder / "test" / "000003"
    camera = {"cam_K": [10.0, 0, 5.5, 0, 11.0, 3.5, 0, 0, 1], "depth_scale": 0.1}
    camera |= {"cam_R_w2c": TURN, "cam_t_w2c": [0.0, 0.0, 500.0]}
    pose = {"obj_id": 1, "cam_R_m2c": TURN, "cam_t_m2c": [10.0, 20.0, 510.0]}
    target = {"scene_id": 3, "im_id": 0, "obj_id": 1, "inst_count": 1}
    box = {"bbox": [1.0, 2.0, 3.0, 3.0], "segmentation": SEGMENTATION}
    files: dict[str, Any] = {
        "test/000003/scene_camera.json": {"0": camera},
        "test/000003/scene_gt.json": {"0": [pose]},
        "test/000003/scene_gt_info.json": {"0": [{"visib_fract": 1.0}]},
        "test_targets_bop19.json": [target],
        "levels.json": {"3": {"0": {"0": 1}}},
        "detections.json": [IMAGE | box],
    }
    for name in ("depth", "rgb", "mask_visib"):
        (scene / name).mkdir(parents=True)
    _write_image(scene / "depth" / "000000.png", _depth())
    _write_image(scene / "rgb" / "000000.png", np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    _write_image(scene / "mask_visib" / "000000_000000.png", _depth().astype(np.uint8))
    for name, value in files.items():
        (folder / name).write_text(json.dumps(value))
    return list(files)


def csv_target(folder: Path) -> Target:
    """Results, and the progress file of an interrupted run."""
    row = results.ResultRow(3, 0, 1, 0.5, np.eye(4), 1.0)
    with ResultsWriter(folder / "r.csv", settings={"seed": "0"}) as writer:
        writer.write_image(3, 0, [row], 1.0)

    def read(path: Path) -> None:
        """Reads results, or resumes the run whose progress the file tells."""
        if path.suffix == ".csv":
            with only_physim_errors():
                results.read_results(path)
            return
        keep = (folder / "r.csv").read_bytes()
        with (
            only_physim_errors(),
            ResultsWriter(folder / "r.csv", resume=True, settings={"seed": "0"}),
        ):
            pass
        (folder / "r.csv").write_bytes(keep)

    return _files_target(folder, ["r.csv", "r.csv.progress"], read)


def rle_target(folder: Path) -> Target:
    """Run-length encoded masks, packed and as lists."""
    listed = SEGMENTATION | {"counts": [40, 6, 50]}
    for name, value in (("packed.json", SEGMENTATION), ("list.json", listed)):
        (folder / name).write_text(json.dumps(value))

    def read(path: Path) -> None:
        """Decodes a mask, whose shape must be the image's."""
        with only_physim_errors():
            runs = rle.read_runs(json_nodes.read_json(path), WIDTH, HEIGHT)
            assert rle.decode_runs(runs, WIDTH, HEIGHT).shape == (HEIGHT, WIDTH)

    return _files_target(folder, ["packed.json", "list.json"], read)


def png_target(folder: Path) -> Target:
    """Depth, colour and mask images. Checksums are mended, to get further."""
    _write_image(folder / "depth.png", _depth())
    _write_image(folder / "color.png", np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    _write_image(folder / "color.jpg", np.zeros((HEIGHT, WIDTH, 3), np.uint8))

    def read(path: Path) -> None:
        """Reads the image in each way, as it is and mended."""
        for mend in (False, True):
            if mend:
                path.write_bytes(_with_checksums(path.read_bytes()))
            for ask in (
                images.png_size,
                images.read_depth,
                images.read_color,
                images.read_mask,
            ):
                with only_physim_errors():
                    ask(path)

    return _files_target(folder, ["depth.png", "color.png", "color.jpg"], read)


def mesh_target(folder: Path) -> Target:
    """Meshes with their materials and textures, and the lists of objects."""
    from physim_drake.objects.library_files import find_objects
    from physim_drake.objects.mesh_assets import find_texture
    from physim_drake.objects.meshes import read_mesh
    from physim_drake.objects.model import ObjectLibrary

    _write_meshes(folder)
    _write_lists(folder)
    names = sorted(
        str(p.relative_to(folder)) for p in folder.rglob("*.*") if p.suffix != ".png"
    )

    def read(path: Path) -> None:
        """Reads the mesh or list, or the mesh that the material belongs to."""
        with only_physim_errors():
            if path.suffix == ".mtl":
                path = folder / "a.obj"
            if path.suffix == ".yaml":
                ObjectLibrary.load(folder)
            elif path.suffix == ".json":
                find_objects(folder / "bop")
            else:
                find_texture(path)
                read_mesh(path).mesh.convex_hull  # noqa: B018

    return _files_target(folder, names, read)


def _write_meshes(folder: Path) -> None:
    """Writes a box in every format, one with a material and a texture."""
    Image.new("RGB", (4, 4)).save(folder / "t.png")
    mesh = trimesh.creation.box((0.05, 0.08, 0.12))
    corners = np.asarray(mesh.vertices)[:, :2]
    mesh.visual = trimesh.visual.TextureVisuals(
        uv=corners, image=Image.new("RGB", (2, 2))
    )
    (folder / "a.mtl").write_text("newmtl m\nKd 1 1 1\nmap_Kd t.png\n")
    text = mesh.export(file_type="obj", include_texture=False, include_normals=False)
    (folder / "a.obj").write_text(f"mtllib a.mtl\nusemtl m\n{text}")
    for name, kind, options in (
        ("text.ply", "ply", {"encoding": "ascii"}),
        ("b.ply", "ply", {}),
        ("b.stl", "stl", {}),
        ("text.stl", "stl_ascii", {}),
        ("c.glb", "glb", {}),
    ):
        data = mesh.export(file_type=kind, **options)
        (folder / name).write_bytes(data.encode() if isinstance(data, str) else data)


def _write_lists(folder: Path) -> None:
    """Writes a library of that box, and a folder of models as BOP has them."""
    (folder / "library.yaml").write_text(
        "objects:\n- id: 3\n  name: carton\n  mesh: a.obj\n  mass: 0.2\n"
        "  collision: [b.ply]\n  symmetry: {discrete: "
        "[[-1,0,0,0, 0,-1,0,0, 0,0,1,0, 0,0,0,1]], "
        "continuous: [{axis: [0, 0, 2], point: [0.005, 0, 0]}]}\n"
    )
    bop_models = folder / "bop"
    bop_models.mkdir()
    (bop_models / "obj_000001.ply").write_bytes((folder / "b.ply").read_bytes())
    info = {"symmetries_discrete": [list(np.eye(4).ravel())]}
    info["symmetries_continuous"] = [{"axis": [0, 0, 1], "offset": [0, 0, 0]}]
    (bop_models / "models_info.json").write_text(json.dumps({"1": info}))


def yaml_target(folder: Path) -> Target:
    """Scenarios of the pick cell, and configurations of perception."""
    from physim_drake.picking.scenario import load_scenario
    from physim_drake.systems.perception_config import PerceptionConfig

    scenarios = Path(__file__).parents[1] / "examples" / "scenarios"
    (folder / "scenario.yaml").write_bytes((scenarios / "clutter.yaml").read_bytes())
    (folder / "perception.yaml").write_text(
        "camera: {name: d415}\nestimator: {workers: 2}\nperiod: 0.5\n"
        "objects: {a: b, c: d}\nvisualize: true\n"
    )

    def read(path: Path) -> None:
        """Loads the scenario or the configuration."""
        with only_physim_errors():
            if path.name == "scenario.yaml":
                load_scenario(path)
            else:
                PerceptionConfig.load(path)

    return _files_target(folder, ["scenario.yaml", "perception.yaml"], read)


def weights_target(folder: Path) -> Target:
    """Weights of a network, the state and the log of a training run."""
    from physim_drake.detection.networks import weights
    from physim_drake.detection.training import training_log

    state = _write_training(folder)

    def read(path: Path) -> None:
        """Loads the weights or the state, or cuts the log."""
        with only_physim_errors():
            if path.name == "w.safetensors":
                weights.load_weights(path)
            elif path.name == "state.safetensors":
                state.load(path, {"seed": 1})
            else:
                training_log.TrainingLog(folder, {"seed": 1}).cut(0)

    names = ["w.safetensors", "state.safetensors", training_log.LOG_FILE]
    return _files_target(folder, names, read)


def _write_training(folder: Path) -> TrainingState:
    """Writes weights, a state and a log. Returns what the state can be loaded into."""
    import torch

    from physim_drake.detection.networks import weights
    from physim_drake.detection.networks.config import NetworkConfig
    from physim_drake.detection.networks.factory import ObjectClass, make_network
    from physim_drake.detection.training import training_log
    from physim_drake.detection.training.checkpoints import (
        AveragedWeights,
        TrainingState,
    )

    config = NetworkConfig(
        image_size=32,
        widths=(16, 16, 16, 16),
        depths=(1, 1, 1, 1),
        pyramid_channels=16,
        head_channels=16,
        mask_layers=1,
    )
    torch.manual_seed(0)
    network = make_network(config, 1)
    weights.save_weights(
        folder / "w.safetensors", network.state_dict(), config, [ObjectClass(1, "a")]
    )
    layer = torch.nn.Linear(2, 1)
    state = TrainingState(
        layer, AveragedWeights(layer), torch.optim.SGD(layer.parameters(), 0.1)
    )
    state.save(folder / "state.safetensors", 3, {"seed": 1})
    (folder / training_log.LOG_FILE).write_text(
        json.dumps({"settings": {"seed": 1}, "losses": [{"step": 1}], "tests": []})
    )
    return state


TARGETS: dict[str, Callable[[Path], Target]] = {
    "bop": bop_target,
    "csv": csv_target,
    "rle": rle_target,
    "png": png_target,
    "mesh": mesh_target,
    "yaml": yaml_target,
    "weights": weights_target,
}
"""Makes a target in an empty folder, by name."""


def _depth() -> np.ndarray:
    return np.arange(WIDTH * HEIGHT, dtype=np.uint16).reshape(HEIGHT, WIDTH) + 5000


def _write_image(path: Path, image: np.ndarray) -> None:
    assert cv2.imwrite(str(path), image)


def _with_checksums(data: bytes) -> bytes:
    """A PNG whose chunks have the checksums that their bytes ask for."""
    result, position = bytearray(data), 8
    while position + 12 <= len(result):
        end = position + 8 + int.from_bytes(result[position : position + 4], "big")
        if end + 4 > len(result):
            break
        checksum = zlib.crc32(result[position + 4 : end])
        result[end : end + 4] = checksum.to_bytes(4, "big")
        position = end + 4
    return bytes(result)
