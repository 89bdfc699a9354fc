# SPDX-License-Identifier: MIT
"""Crafted names in files lead to no file outside the folders that were given."""

from __future__ import annotations

from pathlib import Path

import pytest
import trimesh
from PIL import Image

from physim_drake.datasets.bop import BopDataset
from physim_drake.errors import InputError
from physim_drake.objects.mesh_assets import FolderResolver, find_asset, find_texture
from physim_drake.objects.meshes import read_raw_mesh
from physim_drake.objects.model import ObjectLibrary, ObjectModel
from physim_drake.objects.sdformat import file_stem, write_drake_model
from physim_drake.picking.scenario import load_scenario
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from tests.test_scene_estimate import X_A, estimate_of

BOX = trimesh.creation.box((0.05, 0.08, 0.12))
CRAFTED = ["../../evil", "/tmp/evil", "..", ".", "", "a/b", "a\\b", "a\nb", "x" * 500]


@pytest.fixture
def outside(tmp_path: Path) -> Path:
    """A folder whose sibling, `given`, is the one that is given."""
    (tmp_path / "given").mkdir()
    Image.new("RGB", (4, 4), (9, 8, 7)).save(tmp_path / "secret.png")
    (tmp_path / "secret.mtl").write_text("newmtl m\nmap_Kd t.png\n")
    BOX.export(tmp_path / "secret.obj")
    return tmp_path


def files_below(folder: Path) -> set[Path]:
    return {p for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize("name", CRAFTED)
def test_a_models_name_never_leaves_its_folder(outside: Path, name: str) -> None:
    model = ObjectModel.from_mesh(1, name, BOX)
    before = files_below(outside)
    sdf = write_drake_model(model, outside / "given")
    assert sdf.parent == outside / "given"
    made = files_below(outside) - before
    assert made == files_below(outside / "given")
    assert "/" not in file_stem(name)
    assert 0 < len(file_stem(name)) <= 100


@pytest.mark.parametrize("name", CRAFTED)
def test_directives_stay_in_their_folder(outside: Path, name: str) -> None:
    result: SceneEstimate = estimate_of([ObjectEstimate(1, name, X_A, X_A, 1.0, "")])
    library = ObjectLibrary([ObjectModel.from_mesh(1, name, BOX)], "here")
    before = files_below(outside)
    result.to_model_directives(library, outside / "given")
    assert files_below(outside) - before == files_below(outside / "given")


def test_objects_whose_names_become_one_keep_files_of_their_own(outside: Path) -> None:
    names = {1: "a/b", 2: "a b", 3: "a_b"}
    library = ObjectLibrary(
        [ObjectModel.from_mesh(i, n, BOX) for i, n in names.items()], "here"
    )
    result = estimate_of(
        [ObjectEstimate(i, n, X_A, X_A, 1.0, "") for i, n in names.items()]
    )
    result.to_model_directives(library, outside / "given")
    assert len(list((outside / "given").glob("*/*.sdf"))) == 3


@pytest.mark.parametrize(
    "name",
    [
        *("../secret.png", "{outside}/secret.png", "..\\secret.png", "C:\\secret.png"),
        *("a/../../secret.png", "..", "", "\0", "x" * 5000),
    ],
)
def test_assets_are_found_below_the_meshes_folder_only(
    outside: Path, name: str
) -> None:
    name = name.format(outside=outside)
    folder = outside / "given"
    assert find_asset(folder, name) is None
    with pytest.raises(FileNotFoundError):
        FolderResolver(folder).get(name)
    # The last part is taken where it does lie there: exporters write full paths.
    Image.new("RGB", (4, 4)).save(folder / "secret.png")
    found = find_asset(folder, name)
    assert found in (None, folder / "secret.png")


def test_materials_and_textures_outside_are_not_read(outside: Path) -> None:
    folder = outside / "given"
    text = BOX.export(file_type="obj")
    mesh = folder / "a.obj"
    for library in ("../secret.mtl", str(outside / "secret.mtl")):
        mesh.write_text(f"mtllib {library}\nusemtl m\n{text}")
        Image.new("RGB", (4, 4)).save(folder / "t.png")
        assert find_texture(mesh) is None
        assert read_raw_mesh(mesh).visual.kind != "texture"
    mesh.write_text(f"mtllib a.mtl\nusemtl m\n{text}")
    for image in ("../secret.png", str(outside / "secret.png")):
        (folder / "a.mtl").write_text(f"newmtl m\nmap_Kd {image}\n")
        assert find_texture(mesh) is None
    (folder / "a.mtl").write_text("newmtl m\nmap_Kd t.png\n")
    assert find_texture(mesh) == folder / "t.png"


def test_a_ply_texture_outside_is_not_read(outside: Path) -> None:
    text = BOX.export(file_type="ply", encoding="ascii").decode()
    mesh = outside / "given" / "a.ply"
    line = "comment TextureFile ../secret.png\nelement vertex"
    mesh.write_text(text.replace("element vertex", line, 1))
    assert find_texture(mesh) is None
    assert len(read_raw_mesh(mesh).faces) == 12


@pytest.mark.parametrize("field", ["mesh: {}", "mesh: a.obj, collision: [{}]"])
@pytest.mark.parametrize("name", ["../secret.obj", "{outside}/secret.obj"])
def test_library_meshes_outside_are_refused(
    outside: Path, field: str, name: str
) -> None:
    folder = outside / "given"
    BOX.export(folder / "a.obj")
    mesh = field.format(name.format(outside=outside))
    (folder / "library.yaml").write_text(f"objects: [{{id: 1, {mesh}}}]")
    with pytest.raises(InputError, match="library's folder or below"):
        ObjectLibrary.load(folder)


@pytest.mark.parametrize("name", ["../x", "a/b", "/tmp", "..", "test/../../x", "a\0"])
def test_splits_are_plain_names(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="split"):
        BopDataset(tmp_path, name)


def test_a_scenarios_own_package_ends_at_its_folder(tmp_path: Path) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_text("directives:\n- add_directives: {file: package://scenario/../x}\n")
    with pytest.raises(InputError, match="leaves the scenario's folder"):
        load_scenario(path)


def test_names_that_a_terminal_would_obey_are_escaped(tmp_path: Path) -> None:
    error = InputError(tmp_path, "has no \x1b[2Jobject\n\ud800", "rename it")
    assert str(error).isprintable()
    assert r"\x1b[2Jobject\n\ud800" in str(error)
