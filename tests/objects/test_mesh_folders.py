# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
import logging
from pathlib import Path

import numpy as np
import pytest
import trimesh

from physim_drake.errors import InputError
from physim_drake.objects.mesh_folders import find_meshes
from physim_drake.objects.meshes import read_mesh
from physim_drake.objects.model import ObjectLibrary

BOX = (0.05, 0.08, 0.12)


def put(root: Path, *names: str, scale: float = 1.0) -> None:
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        trimesh.creation.box(np.array(BOX) * scale).export(root / name)


def listed(root: Path) -> list[tuple[str, str]]:
    return [(n, p.relative_to(root).as_posix()) for n, p in find_meshes(root)]


def test_a_folder_of_ycb_is_one_object(tmp_path: Path) -> None:
    can, mug = "002_master_chef_can", "025_mug"
    put(
        tmp_path,
        *(f"{can}/{r}/textured.obj" for r in ("google_16k", "google_64k", "tsdf")),
        f"{can}/google_16k/nontextured.ply",
        f"{can}/google_16k/nontextured.stl",
        f"{can}/google_16k/textured_vhacd_0.obj",
        f"{mug}/poisson/nontextured.ply",
    )
    expected = [
        (can, f"{can}/google_16k/textured.obj"),
        (mug, f"{mug}/poisson/nontextured.ply"),
    ]
    assert listed(tmp_path) == expected
    assert listed(tmp_path / can) == [(can, "google_16k/textured.obj")]


def test_a_mesh_in_another_format_is_not_another_object(tmp_path: Path) -> None:
    put(tmp_path, "a.stl", "a.obj", "b.ply", "cup/model.obj", "cup/collision_0.obj")
    assert listed(tmp_path) == [
        ("a", "a.obj"),
        ("b", "b.ply"),
        ("cup", "cup/model.obj"),
    ]


def test_files_to_convert_are_named_with_the_command(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "bolt.step").write_text("ISO-10303-21;")
    with pytest.raises(InputError, match=r"bolt\.step; convert it: .*step_to_glb"):
        ObjectLibrary.load(tmp_path)
    put(tmp_path, "a.obj")
    (tmp_path / "a.dae").write_text("<COLLADA/>")
    with caplog.at_level(logging.WARNING):
        assert len(ObjectLibrary.load(tmp_path)) == 1
    assert [r.getMessage().split()[0] for r in caplog.records] == [
        str(tmp_path / "bolt.step")
    ]
    with pytest.raises(InputError, match=r"\.dae is not read; convert it: .*collada"):
        read_mesh(tmp_path / "a.dae")


@pytest.mark.parametrize("scale", [1.0, 1e3])
def test_glb_in_a_bop_folder_is_in_the_unit_of_models_info(
    tmp_path: Path, scale: float
) -> None:
    put(tmp_path, "obj_000001.glb", scale=scale)
    info = {"1": {"diameter": 1e3 * float(np.linalg.norm(BOX))}}
    (tmp_path / "models_info.json").write_text(json.dumps(info))
    np.testing.assert_allclose(ObjectLibrary.load(tmp_path)[1].extents, BOX, atol=1e-6)


def gltf(folder: Path, uri: str = "a.bin") -> Path:
    """A box as glTF in JSON, with a KTX2 texture that nothing here decodes."""
    files = trimesh.exchange.gltf.export_gltf(
        trimesh.Scene(trimesh.creation.box(BOX)), merge_buffers=True
    )
    tree = json.loads(files.pop("model.gltf"))
    (folder / "a.bin").write_bytes(next(iter(files.values())))
    tree["buffers"][0]["uri"] = uri
    tree["images"] = [{"mimeType": "image/ktx2", "uri": "a.ktx2"}]
    (folder / "a.ktx2").write_bytes(b"\xabKTX 20\xbb")
    (folder / "a.gltf").write_text(json.dumps(tree))
    return folder / "a.gltf"


def test_gltf_with_its_data_beside_it(tmp_path: Path) -> None:
    mesh = read_mesh(gltf(tmp_path)).mesh
    np.testing.assert_allclose(mesh.extents, BOX, atol=1e-6)


@pytest.mark.parametrize("uri", ["../a.bin", "/etc/passwd", "absent.bin"])
def test_gltf_whose_data_are_not_beside_it(tmp_path: Path, uri: str) -> None:
    with pytest.raises(InputError, match="its data"):
        read_mesh(gltf(tmp_path, uri))


def test_gltf_that_promises_more_data_than_there_are(tmp_path: Path) -> None:
    path = gltf(tmp_path)
    (tmp_path / "a.bin").write_bytes(b"1234")
    with pytest.raises(InputError, match="ends after its data"):
        read_mesh(path)


def test_drakes_own_ycb_mesh_loads(shared: Path) -> None:
    folder = shared / "data" / "drake-ycb" / "meshes"
    model = ObjectLibrary.load(folder)[1]
    assert model.diameter == pytest.approx(0.198, abs=0.005)
