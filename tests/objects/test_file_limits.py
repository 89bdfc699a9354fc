# SPDX-License-Identifier: MIT
"""Files that claim to be enormous, refused before memory is taken for them."""

from __future__ import annotations

import json
import struct
import tracemalloc
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image
from safetensors.torch import save_file

from physim_drake.datasets.images import read_color, read_depth
from physim_drake.datasets.results import read_results
from physim_drake.datasets.rle import read_runs
from physim_drake.detection.networks.config import NetworkConfig
from physim_drake.detection.networks.factory import ObjectClass
from physim_drake.detection.networks.weights import (
    describe,
    load_weights,
    read_safetensors,
)
from physim_drake.errors import InputError
from physim_drake.objects import glb_limits, mesh_limits
from physim_drake.objects.library_files import find_objects
from physim_drake.objects.mesh_assets import find_texture
from physim_drake.objects.meshes import read_mesh
from physim_drake.storage import json_nodes
from physim_drake.storage.json_nodes import JsonNode, read_json
from physim_drake.storage.typed_yaml import load_typed_yaml

MB = 1_000_000


@contextmanager
def little_memory(limit: int = 20 * MB) -> Iterator[None]:
    """Fails if Python or numpy take more memory at once than `limit`."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < limit
    finally:
        tracemalloc.stop()


def sparse_file(path: Path, size: int) -> Path:
    with path.open("wb") as file:
        file.truncate(size)
    return path


def png(width: int, height: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        checksum = struct.pack(">I", zlib.crc32(kind + data))
        return struct.pack(">I", len(data)) + kind + data + checksum

    head = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    return b"".join(
        [
            b"\x89PNG\r\n\x1a\n",
            chunk(b"IHDR", head),
            chunk(b"IDAT", zlib.compress(bytes(1000))),
            chunk(b"IEND", b""),
        ]
    )


def ply(vertices: int, faces: int, encoding: str = "binary_little_endian") -> bytes:
    return (
        f"ply\nformat {encoding} 1.0\nelement vertex {vertices}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()


@pytest.mark.parametrize("reader", [read_depth, read_color])
def test_an_image_that_says_it_is_enormous(tmp_path: Path, reader: Callable) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(png(1_000_000, 1_000_000))
    with little_memory(), pytest.raises(InputError, match="may have 1 to 64000000"):
        reader(path)


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
@pytest.mark.parametrize("counts", [(10**12, 4), (4, 10**12), (5 * MB, MB), (4, 4)])
def test_a_ply_header_that_promises_more_than_follows(
    tmp_path: Path, counts: tuple[int, int], encoding: str
) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(ply(*counts, encoding))
    with little_memory(), pytest.raises(InputError, match=r"a\.ply"):
        read_mesh(path)


@pytest.mark.parametrize(
    "line",
    [
        "element vertex -1",
        "element vertex 8",
        "property float",
        "property list uchar int",
        "property quaternion q",
        "property list int list_of_lists x",
        "format klingon 1.0",
        "nonsense",
    ],
)
def test_impossible_ply_headers(tmp_path: Path, line: str) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(ply(4, 4).replace(b"end_header", f"{line}\nend_header".encode()))
    with pytest.raises(InputError, match=r"a\.ply"):
        read_mesh(path)


@pytest.mark.parametrize("suffix", [".obj", ".stl", ".ply", ".glb"])
def test_a_mesh_file_of_many_gigabytes_is_not_read(tmp_path: Path, suffix: str) -> None:
    path = sparse_file(tmp_path / f"a{suffix}", 20_000 * MB)
    with little_memory(), pytest.raises(InputError, match="has 20000 MB"):
        read_mesh(path)


def test_text_meshes_of_too_many_lines_or_faces(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.obj"
    trimesh.creation.box((0.1, 0.1, 0.1)).export(path)
    fan = "f " + " ".join(["1", "2", "3", "4"] * 4) + "\n"
    for name, limit, match in (
        ("MAX_FACES", 11, "12 faces"),
        ("MAX_VERTICES", 7, "8 vertices"),
        ("_MAX_LINES", 12, "lines"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(mesh_limits, name, limit)
            with pytest.raises(InputError, match=match):
                read_mesh(path)
    monkeypatch.setattr(mesh_limits, "MAX_FACES", 25)
    path.write_text(path.read_text() + fan)  # a polygon of 16 corners is 14 triangles
    with pytest.raises(InputError, match="26 faces"):
        read_mesh(path)


def glb(change: Callable[[dict], None]) -> bytes:
    data = trimesh.creation.box((0.1, 0.1, 0.1)).export(file_type="glb")
    length = struct.unpack_from("<I", data, 12)[0]
    tree = json.loads(data[20 : 20 + length])
    change(tree)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    head = data[:12] + struct.pack("<I4s", len(text), b"JSON")
    return head + text + data[20 + length :]


def set_in(*places: str | int, to: object) -> Callable[[dict], None]:
    def change(tree: dict) -> None:
        value = tree
        for place in places[:-1]:
            value = value[place]
        value[places[-1]] = to

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (set_in("accessors", 0, "count", to=10**12), "count is 1000000000000|ends"),
        (set_in("accessors", 0, "count", to=-1), "count is -1"),
        (set_in("accessors", 0, "byteOffset", to=-8), "byteOffset is -8"),
        (set_in("accessors", 0, "componentType", to=1), "no glTF"),
        (lambda tree: tree["accessors"][0].pop("bufferView"), "sparse or missing"),
        (set_in("bufferViews", 0, "byteLength", to=10**9), "ends after its data"),
        (set_in("bufferViews", 0, "byteStride", to=-4), "byteStride is -4"),
        (set_in("bufferViews", 0, "byteStride", to=1), "stride is not in 4"),
        (set_in("buffers", 0, "uri", to="../secret.bin"), "refers to other files"),
        (set_in("images", to=[{"uri": "/etc/passwd"}]), "refers to other files"),
        (set_in("nodes", to=[{"mesh": 0}] * 60_000), "faces, at most"),
        (set_in("nodes", to=[{}] * 200_000), "200000 nodes"),
        (set_in("nodes", 0, to={"mesh": 7}), "number 7 of 1"),
        (set_in("accessors", to=3), "no glTF"),
    ],
)
def test_impossible_glb_files(
    tmp_path: Path,
    change: Callable[[dict], None],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(mesh_limits, "MAX_FACES", 100_000)
    path = tmp_path / "a.glb"
    path.write_bytes(glb(lambda tree: None))
    assert len(read_mesh(path).mesh.faces) == 12
    path.write_bytes(glb(change))
    with pytest.raises(InputError, match=message):
        read_mesh(path)


def test_a_glb_texture_that_says_it_is_enormous(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = trimesh.creation.box((0.1, 0.1, 0.1))
    image = Image.new("RGB", (64, 64))
    mesh.visual = trimesh.visual.TextureVisuals(
        uv=np.asarray(mesh.vertices)[:, :2],
        material=trimesh.visual.material.PBRMaterial(baseColorTexture=image),
    )
    path = tmp_path / "a.glb"
    path.write_bytes(mesh.export(file_type="glb"))
    assert len(read_mesh(path).mesh.faces) == 12
    monkeypatch.setattr(glb_limits, "MAX_TEXTURE_PIXELS", 4095)
    with pytest.raises(InputError, match="texture of 64 x 64 pixels"):
        read_mesh(path)


def test_a_texture_that_says_it_is_enormous_is_left_out(tmp_path: Path) -> None:
    mesh = tmp_path / "a.obj"
    text = trimesh.creation.box((0.1, 0.1, 0.1)).export(file_type="obj")
    mesh.write_text(f"mtllib a.mtl\nusemtl m\n{text}")
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd t.png\n")
    Image.new("RGB", (4, 4)).save(tmp_path / "t.png")
    assert find_texture(mesh) == tmp_path / "t.png"
    (tmp_path / "t.png").write_bytes(png(100_000, 100_000))
    with little_memory():
        assert find_texture(mesh) is None
        assert len(read_mesh(mesh).mesh.faces) == 12


@pytest.mark.parametrize(
    "counts",
    [
        [0, 10**9, 96],
        [-1, 97],
        [1 << 62, 1 << 62, 1 << 62, 1 << 62, 96],
        "oooooooooooooooooooooooooooooooo0",
        # Runs of 2^34 and more, whose sum wraps around.
        "PPPPPP7" * 40_000,
        "\ud800",
    ],
)
def test_runs_beyond_the_image(counts: object) -> None:
    node = JsonNode({"size": [8, 12], "counts": counts}, Path("d.json"))
    with little_memory(), pytest.raises(InputError, match="counts"):
        read_runs(node, 12, 8)


@pytest.mark.parametrize("opening", ["[", '{"a":', '[{"a":['])
def test_json_nested_without_end(tmp_path: Path, opening: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(opening * 200_000)
    with pytest.raises(InputError, match="is not valid JSON"):
        read_json(path)


def test_json_with_a_key_given_twice(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text('{"0": {"x": 1, "x": 2}}')
    with pytest.raises(InputError, match="key 'x' is given twice"):
        read_json(path)


def test_text_files_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(json_nodes, "MAX_JSON_BYTES", MB)
    with little_memory(), pytest.raises(InputError, match="more than 1000000 bytes"):
        read_json(Path("/dev/zero"))
    with little_memory(), pytest.raises(InputError, match="more than 1000000 bytes"):
        load_typed_yaml(Path("/dev/zero"), NetworkConfig)


def test_results_of_many_gigabytes(tmp_path: Path) -> None:
    path = sparse_file(tmp_path / "r.csv", 1000)
    with pytest.raises(InputError, match=r"first line lacks|CSV"):
        read_results(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: &a [" + "1, " * 999 + "]\nb: &b [" + "*a, " * 999 + "]", "200000 values"),
        ("{a: " * 60 + "1" + "}" * 60, "nested more than 50"),
        ("[" * 100_000, "nested more than 50"),
        ("image_size: 3\nimage_size: 4", "'image_size' is given twice"),
        ("x: !!python/object/apply:os.system [id]", "YAML|python"),
    ],
)
def test_yaml_that_stands_for_more_than_it_says(
    tmp_path: Path, text: str, message: str
) -> None:
    path = tmp_path / "library.yaml"
    path.write_text(text)
    with little_memory(), pytest.raises(InputError, match=message):
        load_typed_yaml(path, NetworkConfig)
    with little_memory(), pytest.raises(InputError, match=r"library\.yaml"):
        find_objects(tmp_path)


def test_a_safetensors_header_that_promises_too_much(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    entry = {"dtype": "F32", "shape": [1 << 40], "data_offsets": [0, 1 << 42]}
    head = json.dumps({"x": entry}).encode()
    for length in (len(head), 1 << 40, (1 << 64) - 1):
        path.write_bytes(struct.pack("<Q", length) + head)
        with little_memory(), pytest.raises(InputError, match="is damaged"):
            read_safetensors(path, "")


def test_weights_of_a_network_that_would_not_fit_in_memory(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    config = NetworkConfig(widths=(4096,) * 4, depths=(8,) * 4, head_channels=4096)
    save_file({"x": torch.zeros(1)}, path, describe(config, [ObjectClass(1, "a")]))
    with (
        little_memory(100 * MB),
        pytest.raises(InputError, match="holds 1 numbers, its"),
    ):
        load_weights(path)


@pytest.mark.parametrize("values", [{"widths": [1] * 4}, {"depths": [4096] * 4}])
def test_weights_of_an_impossible_network(tmp_path: Path, values: dict) -> None:
    path = tmp_path / "w.safetensors"
    facts = describe(NetworkConfig(), [ObjectClass(1, "a")])
    network = json.loads(facts["network"]) | values
    save_file(
        {"x": torch.zeros(2_000_000)}, path, facts | {"network": json.dumps(network)}
    )
    with pytest.raises(InputError, match="metadata"):
        load_weights(path)
