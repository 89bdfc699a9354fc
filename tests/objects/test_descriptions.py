# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from physim_drake.errors import InputError
from physim_drake.objects.model import ObjectLibrary
from physim_drake.objects.sdformat import write_drake_model

BOX = (0.05, 0.08, 0.12)
SDF = """<sdf version="1.9"><model name="carton"><link name="body">
<inertial><pose>0 0 0.01 0 0 0</pose><mass>0.4</mass><inertia><ixx>3e-3</ixx>
<iyy>2e-3</iyy><izz>1e-3</izz></inertia></inertial>
<visual name="v"><pose degrees="true">0.1 0 0 0 0 90</pose><geometry><mesh>
<uri>package://any/meshes/carton.obj</uri><scale>0.5 0.5 0.5</scale></mesh></geometry>
</visual></link></model></sdf>"""
URDF = """<robot name="carton"><link name="body">
<inertial><origin xyz="0 0 0.01"/><mass value="0.4"/>
<inertia ixx="3e-3" iyy="2e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><origin xyz="0.1 0 0" rpy="0 0 1.5707963267948966"/><geometry>
<mesh filename="meshes/carton.obj" scale="0.5 0.5 0.5"/></geometry></visual>
</link></robot>"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "meshes").mkdir()
    box = trimesh.creation.box(BOX)
    box.export(tmp_path / "meshes" / "carton.obj")
    box.export(tmp_path / "meshes" / "carton_low.obj")
    return tmp_path


@pytest.mark.parametrize(("name", "text"), [("a.sdf", SDF), ("a.urdf", URDF)])
def test_a_mesh_is_posed_and_scaled_in_its_link(
    folder: Path, name: str, text: str
) -> None:
    (folder / name).write_text(text)
    library = ObjectLibrary.load(folder)
    model = library[1]
    assert (library.ids, model.name, model.mass) == ((1,), "carton", 0.4)
    expected = [[0.08, -0.0125, -0.03], [0.12, 0.0125, 0.03]]
    np.testing.assert_allclose(model.mesh.bounds, expected, atol=1e-7)
    np.testing.assert_allclose(model.center_of_mass, [0, 0, 0.01])
    np.testing.assert_allclose(model.inertia, np.diag([3e-3, 2e-3, 1e-3]))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0.5 0.5 0.5", "1 2 1", "one positive factor"),
        ("carton.obj", "absent.obj", "which is not below"),
        ("package://any/", "/etc/", "which is not below"),
        ("0.1 0 0 0 0 90", "0.1 0", "6 finite numbers"),
        ('degrees="true"', 'relative_to="f"', "relative_to another frame"),
        ("<mass>0.4", "<mass>-1", "must be positive"),
        ("</sdf>", "", "not valid XML"),
    ],
)
def test_what_is_not_read_is_named(
    folder: Path, old: str, new: str, message: str
) -> None:
    (folder / "a.sdf").write_text(SDF.replace(old, new))
    with pytest.raises(InputError, match=message):
        ObjectLibrary.load(folder)


def test_drake_puts_the_mesh_of_its_own_ycb_in_the_same_place(
    shared: Path, tmp_path: Path
) -> None:
    model = ObjectLibrary.load(shared / "data" / "drake-ycb")[1]
    assert (model.name, model.mass) == ("006_mustard_bottle", 0.603)
    # The contact points that its makers put on the corners of the visual box.
    corner = np.array([0.0455, 0.09315, 0.0266])
    low, high = model.mesh.bounds
    np.testing.assert_allclose([low[0], low[2]], -corner[[0, 2]], atol=0.008)
    np.testing.assert_allclose(high, corner, atol=0.008)
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.01)
    Parser(plant).AddModels(str(write_drake_model(model, tmp_path)))
    plant.Finalize()
