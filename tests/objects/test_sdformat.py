# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from pydrake.geometry import Role
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder
from typer.testing import CliRunner

from physim_drake.cli.models import models_app
from physim_drake.objects.model import ObjectLibrary, ObjectModel
from physim_drake.objects.sdformat import write_drake_model

TEXTURED = """mtllib box.mtl
usemtl paint
{vertices}
vt 0 0
vt 1 0
vt 0 1
{faces}
"""


@pytest.fixture
def textured(tmp_path: Path) -> Path:
    mesh = trimesh.creation.box((0.05, 0.08, 0.12))
    mesh.apply_translation([0.01, 0.0, 0.02])
    text = TEXTURED.format(
        vertices="\n".join("v {} {} {}".format(*v) for v in mesh.vertices),
        faces="\n".join("f {}/1 {}/2 {}/3".format(*(f + 1)) for f in mesh.faces),
    )
    (tmp_path / "box.obj").write_text(text)
    (tmp_path / "box.mtl").write_text("newmtl paint\nmap_Kd box.png\n")
    Image.new("RGB", (4, 4), (200, 30, 30)).save(tmp_path / "box.png")
    return tmp_path


def test_drake_reads_what_was_written(textured: Path, tmp_path: Path) -> None:
    model = ObjectLibrary.load(textured)[1]
    path = write_drake_model(model, tmp_path / "made")
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.01)
    Parser(plant).AddModels(str(path))
    plant.Finalize()
    body = plant.GetBodyByName("body")
    assert body.default_mass() == pytest.approx(model.mass)
    inertia = body.default_spatial_inertia()
    np.testing.assert_allclose(inertia.get_com(), [0.01, 0, 0.02], atol=1e-6)
    about_com = inertia.Shift(inertia.get_com()).CalcRotationalInertia()
    np.testing.assert_allclose(about_com.CopyToFullMatrix3(), model.inertia, atol=1e-9)
    inspector = scene_graph.model_inspector()
    frame = plant.GetBodyFrameIdOrThrow(body.index())
    assert inspector.NumGeometriesForFrameWithRole(frame, Role.kIllustration) == 1
    (geometry,) = inspector.GetGeometries(frame, Role.kProximity)
    properties = inspector.GetProximityProperties(geometry)
    assert properties.GetProperty("hydroelastic", "hydroelastic_modulus") == 1e7
    assert properties.GetProperty(
        "material", "coulomb_friction"
    ).static_friction() == pytest.approx(0.8)


def test_texture_and_seams_are_kept(textured: Path, tmp_path: Path) -> None:
    model = ObjectLibrary.load(textured)[1]
    assert model.texture == textured / "box.png"
    assert len(model.mesh.vertices) == 8
    folder = tmp_path / "made"
    write_drake_model(model, folder)
    again = trimesh.load(folder / "box.obj", force="mesh")
    assert again.visual.kind == "texture"
    color = np.array(again.visual.material.image)[0, 0]
    np.testing.assert_allclose(color[:3], [200, 30, 30], atol=5)
    assert "vn " in (folder / "box.obj").read_text()


def test_pieces_and_odd_names(tmp_path: Path) -> None:
    halves = tuple(
        trimesh.creation.box(bounds=[[x, 0, 0], [x + 0.03, 0.05, 0.05]])
        for x in (0, 0.03)
    )
    mesh = trimesh.creation.box(bounds=[[0, 0, 0], [0.06, 0.05, 0.05]])
    model = ObjectModel.from_mesh(1, "a/b & c", mesh, given_pieces=halves)
    path = write_drake_model(model, tmp_path)
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.01)
    Parser(plant).AddModels(str(path))
    plant.Finalize()
    assert plant.num_collision_geometries() == 2


def test_models_check(textured: Path, tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    result = CliRunner().invoke(
        models_app, ["check", str(textured), "--json", str(report)]
    )
    assert result.exit_code == 0, result.output
    assert "50 x 80 x 120" in result.output
    assert '"symmetry": "4 discrete"' in report.read_text()


def test_models_check_goes_on_after_a_bad_file(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text("nonsense")
    trimesh.creation.box((0.05, 0.05, 0.05)).export(tmp_path / "b.ply")
    report = tmp_path / "report.json"
    result = CliRunner().invoke(
        models_app, ["check", str(tmp_path), "--json", str(report)]
    )
    assert result.exit_code == 2
    bad, good = json.loads(report.read_text())
    assert "is no readable mesh" in bad["error"]
    assert good["extents_mm"] == [50.0, 50.0, 50.0]
    assert "1 a cannot be used" in result.output
