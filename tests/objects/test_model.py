# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from physim_drake.errors import InputError
from physim_drake.objects import meshes
from physim_drake.objects.model import DEFAULT_DENSITY, ObjectLibrary, ObjectModel

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
BOX = (0.05, 0.08, 0.12)
LIBRARY = """
objects:
- id: 3
  name: carton
  mesh: carton.obj
  collision: [left.obj, right.obj]
  mass: 0.25
  friction: 0.5
  symmetry:
    discrete: [[-1, 0, 0, 0.01,  0, -1, 0, 0,  0, 0, 1, 0,  0, 0, 0, 1]]
    continuous: [{axis: [0, 0, 2], point: [0.005, 0, 0]}]
"""


def box(extents: tuple[float, ...] = BOX, scale: float = 1.0) -> trimesh.Trimesh:
    return trimesh.creation.box(np.array(extents) * scale)


@pytest.fixture
def loose(tmp_path: Path) -> Path:
    (tmp_path / "below").mkdir()
    box().export(tmp_path / "box10.ply")
    box().export(tmp_path / "box2.obj")
    box().export(tmp_path / "below" / "box1.stl")
    box().export(tmp_path / "box2_collision.obj")
    return tmp_path


@pytest.fixture
def bop(tmp_path: Path) -> Path:
    for i in (1, 5):
        box(scale=1e3).export(tmp_path / f"obj_{i:06d}.ply")
    half = [-1, 0, 0, 10, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    info = {"1": {"diameter": 153.0}, "5": {"symmetries_discrete": [half]}}
    (tmp_path / "models_info.json").write_text(json.dumps(info))
    return tmp_path


def test_loose_meshes_are_numbered_in_natural_order(loose: Path) -> None:
    library = ObjectLibrary.load(loose)
    assert library.ids == tuple(library) == (1, 2, 3)
    assert [model.name for model in library.values()] == ["box1", "box2", "box10"]
    assert library.by_name("box10").object_id == 3
    assert 3 in library
    assert library.get(9) is None


def test_bop_folder_is_read_in_millimetres(bop: Path) -> None:
    library = ObjectLibrary.load(bop)
    np.testing.assert_allclose(library[1].extents, BOX, atol=1e-6)
    assert len(library[1].symmetry.discrete) == 4  # detected
    discrete = library[5].symmetry.discrete  # given
    assert len(discrete) == 2
    np.testing.assert_allclose(discrete[0], np.eye(4))
    assert discrete[1][0, 3] == pytest.approx(0.01)


def test_library_file(tmp_path: Path) -> None:
    box().export(tmp_path / "carton.obj")
    for name in ("left.obj", "right.obj"):
        box((0.025, 0.08, 0.12)).export(tmp_path / name)
    (tmp_path / "library.yaml").write_text(LIBRARY)
    model = ObjectLibrary.load(tmp_path)[3]
    assert (model.name, model.mass, model.friction) == ("carton", 0.25, 0.5)
    assert len(model.collision_pieces) == 2
    np.testing.assert_allclose(model.symmetry.axes[0].axis, [0, 0, 1])
    a, b, c = BOX
    expected = 0.25 / 12 * np.diag([b**2 + c**2, a**2 + c**2, a**2 + b**2])
    np.testing.assert_allclose(model.inertia, expected, atol=1e-9)


def test_unit_and_scale_of_a_library(tmp_path: Path) -> None:
    box(scale=500).export(tmp_path / "a.stl")
    (tmp_path / "library.yaml").write_text(
        "objects: [{id: 1, mesh: a.stl, unit: mm, scale: 2, collision: [a.stl]}]"
    )
    model = ObjectLibrary.load(tmp_path)[1]
    np.testing.assert_allclose(model.extents, BOX, atol=1e-7)
    np.testing.assert_allclose(model.collision_pieces[0].extents, BOX, atol=1e-7)
    assert model.source_unit == pytest.approx(2e-3)


@pytest.mark.parametrize(
    ("scale", "unit", "likely"), [(20.0, "metres", "cm"), (0.07, "metres", None)]
)
def test_a_doubtful_unit_is_told(
    tmp_path: Path, scale: float, unit: str, likely: str | None
) -> None:
    box(scale=scale).export(tmp_path / "a.stl")
    problems = ObjectLibrary.load(tmp_path)[1].problems
    assert [f"values are {unit}" in p and f"unit: {likely}" in p for p in problems] == (
        [True] if likely else []
    )


def test_only_meshes_asked_for_are_read(bop: Path) -> None:
    (bop / "obj_000005.ply").write_text("nonsense")
    assert len(ObjectLibrary.load(bop, [1])) == 1
    with pytest.raises(InputError, match=r"obj_000005\.ply: is no readable mesh"):
        ObjectLibrary.load(bop)


def test_missing_objects_are_named(bop: Path) -> None:
    with pytest.raises(InputError, match=r"no object with id 7; it has 1, 5"):
        ObjectLibrary.load(bop, [7])
    with pytest.raises(InputError, match="no object with id 5; it has 1"):
        ObjectLibrary.load(bop, [1])[5]
    with pytest.raises(InputError, match="no object 'cup'"):
        ObjectLibrary.load(bop).by_name("cup")
    with pytest.raises(InputError, match="is no folder"):
        ObjectLibrary.load(bop / "absent")
    (bop / "empty").mkdir()
    with pytest.raises(InputError, match="holds no object models"):
        ObjectLibrary.load(bop / "empty")


def with_nan(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    vertices = np.array(mesh.vertices)
    vertices[3, 1] = np.nan
    return trimesh.Trimesh(vertices, mesh.faces, process=False)


def flat(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(np.array(mesh.vertices) * [1, 1, 0], mesh.faces)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (with_nan, "vertices: holds NaN"),
        (flat, "is flat"),
        (lambda mesh: mesh.apply_scale(1000), "likely in millimetres"),
        (lambda mesh: mesh.apply_scale(0.001), "across when its values are metres"),
    ],
)
def test_unusable_meshes_are_refused(
    tmp_path: Path,
    spoil: Callable[[trimesh.Trimesh], trimesh.Trimesh],
    message: str,
) -> None:
    spoil(box()).export(tmp_path / "a.stl")
    with pytest.raises(InputError, match=message):
        ObjectLibrary.load(tmp_path)


def test_metres_in_a_bop_folder_are_noticed(tmp_path: Path) -> None:
    box().export(tmp_path / "obj_000001.ply")
    with pytest.raises(InputError, match="likely in metres"):
        ObjectLibrary.load(tmp_path)


@pytest.mark.parametrize("suffix", [".ply", ".stl", ".glb"])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_truncated_files_are_refused(tmp_path: Path, suffix: str, share: float) -> None:
    data = trimesh.creation.icosphere(3, 0.05).export(file_type=suffix[1:])
    (tmp_path / f"a{suffix}").write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError):
        ObjectLibrary.load(tmp_path)


def test_a_text_file_cut_short_is_noticed_by_its_count(tmp_path: Path) -> None:
    mesh = trimesh.creation.icosphere(4, 0.05)
    text = mesh.export(file_type="ply", encoding="ascii")
    (tmp_path / "a.ply").write_bytes(text.rstrip().rsplit(b"\n", 5)[0] + b"\n")
    with pytest.raises(InputError, match="cut short: 5115 of 5120 faces"):
        ObjectLibrary.load(tmp_path)


def test_size_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    box().export(tmp_path / "a.ply")
    monkeypatch.setattr(meshes, "MAX_FACES", 11)
    with pytest.raises(InputError, match="12 faces"):
        ObjectLibrary.load(tmp_path)


@pytest.mark.parametrize(
    ("info", "message"),
    [
        ("{", "is not valid JSON"),
        ("[]", "is no JSON object"),
        ('{"1": 3}', "1: is no JSON object"),
        ('{"1": {"symmetries_discrete": [[1, 2]]}}', "16 finite numbers"),
        ('{"1": {"symmetries_discrete": 1}}', "are no lists"),
        (
            json.dumps({"1": {"symmetries_discrete": [[2.0] * 16]}}),
            r"1\.discrete\[0\]: is no rotation",
        ),
        ('{"1": {"symmetries_continuous": [{"axis": [0, 0, 0]}]}}', "length 0"),
        ('{"1": {"symmetries_continuous": [5]}}', "give axis and offset"),
    ],
)
def test_malformed_models_info(bop: Path, info: str, message: str) -> None:
    (bop / "models_info.json").write_text(info)
    with pytest.raises(InputError, match=message):
        ObjectLibrary.load(bop, [1])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("objects: [{id: 1, mesh: a.obj, colour: red}]", "colour"),
        ("objects: [{id: x, mesh: a.obj}]", "library.yaml"),
        ("objects: 3", "cannot be used"),
        ("objects: [{id: 0, mesh: a.obj}]", r"objects\[0\]\.id"),
        ("objects: [{id: 1}]", r"objects\[0\]\.mesh"),
        ("objects: [{id: 1, mesh: a.obj, unit: feet}]", "give one of m, cm, mm, in"),
        ("objects: [{id: 1, mesh: a.obj, scale: 0}]", r"objects\[0\]\.scale: is 0"),
        ("objects: [{id: 1, mesh: a.obj, mass: -1}]", r"objects\[0\]\.mass: is -1"),
        ("objects: [{id: 1, mesh: a.obj}, {id: 1, mesh: b.obj}]", "gives id 1 to"),
        ("objects: [{id: 1, mesh: a.obj}]", r"a\.obj: does not exist"),
    ],
)
def test_malformed_library(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "library.yaml").write_text(text)
    with pytest.raises(InputError, match=message):
        ObjectLibrary.load(tmp_path)


def test_mass_comes_from_the_volume_where_none_is_given() -> None:
    model = ObjectModel.from_mesh(1, "box", box())
    assert model.mass == pytest.approx(DEFAULT_DENSITY * np.prod(BOX))
    assert model.diameter == pytest.approx(np.linalg.norm(BOX))


def test_surface_sample_is_even_and_repeatable() -> None:
    model = ObjectModel.from_mesh(1, "ball", trimesh.creation.icosphere(4, 0.05))
    points, normals = model.surface_sample(500)
    again, _ = pickle.loads(pickle.dumps(model)).surface_sample(500)
    np.testing.assert_array_equal(points, again)
    assert model.surface_sample(500)[0] is points
    np.testing.assert_allclose(normals, points / 0.05, atol=0.05)
    gaps = np.linalg.norm(points[:, None] - points[None], axis=-1)
    np.fill_diagonal(gaps, 1.0)
    even = np.sqrt(4 * np.pi * 0.05**2 / 500)
    assert gaps.min(axis=1).min() > 0.6 * even


def test_turned_and_doubled_faces_are_put_right() -> None:
    mesh = box()
    faces = np.concatenate([mesh.faces, mesh.faces])[:, ::-1]
    cleaned, problems = meshes.clean_mesh(np.array(mesh.vertices), faces)
    assert len(cleaned.faces) == 12
    assert cleaned.volume == pytest.approx(np.prod(BOX))
    assert len(problems) == 2


def test_real_scans_load_with_their_problems_told() -> None:
    folder = SHARED / "real-ycb" / "models"
    if not folder.is_dir():
        pytest.skip("the real scans are not there")
    library = ObjectLibrary.load(folder)
    assert len(library) == 5
    assert any("edges" in text for text in library[15].problems)
