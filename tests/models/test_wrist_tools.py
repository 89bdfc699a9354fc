# SPDX-License-Identifier: MIT
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
)
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import (
    LoadModelDirectives,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo

from physim_drake.models import (
    PACKAGE_XML,
    REALSENSE_D415,
    SDA10F,
    SUCTION_GRIPPER,
)
from physim_drake.models.make_wrist_tools import make_tools

WITH_TOOLS = SDA10F / "sda10f_with_tools.dmd.yaml"


def loaded(plant: MultibodyPlant, file: Path) -> MultibodyPlant:
    parser = Parser(plant)
    parser.package_map().AddPackageXml(str(PACKAGE_XML))
    if file.suffix == ".yaml":
        ProcessModelDirectives(LoadModelDirectives(str(file)), parser)
    else:
        parser.AddModels(file)
    plant.Finalize()
    return plant


def relative(plant: MultibodyPlant, frame: str, base: str) -> RigidTransform:
    context = plant.CreateDefaultContext()
    return plant.GetFrameByName(frame).CalcPose(context, plant.GetFrameByName(base))


def mesh(path: Path) -> trimesh.Trimesh:
    return trimesh.load(path, force="mesh")


def test_cup_opens_ahead_of_a_slender_tube():
    plant = loaded(MultibodyPlant(0.0), SUCTION_GRIPPER)
    X_GC = relative(plant, "cup", "suction_gripper")
    np.testing.assert_allclose(X_GC.translation(), (0, 0, 0.21), atol=1e-12)
    assert X_GC.rotation().IsNearlyIdentity(1e-12)
    lip = mesh(SUCTION_GRIPPER.parent / "suction_cup.obj").vertices
    X_cup_lip = relative(plant, "cup", "suction_cup").translation()
    assert lip[:, 2].max() == pytest.approx(X_cup_lip[2])
    rim = lip[lip[:, 2] > X_cup_lip[2] - 1e-3]
    assert 2 * np.hypot(rim[:, 0], rim[:, 1]).max() == pytest.approx(0.03, abs=2e-4)
    tube = mesh(SUCTION_GRIPPER.parent / "suction_gripper.obj").vertices
    tube = tube[tube[:, 2] > 0.065]
    assert np.hypot(tube[:, 0], tube[:, 1]).max() < 0.012
    assert tube[:, 2].max() == pytest.approx(0.182)  # where the cup begins


def test_gripper_is_light_enough_for_the_payload():
    plant = loaded(MultibodyPlant(0.0), WITH_TOOLS)
    names = ("suction_gripper", "wrist_bracket", "realsense_d415")
    instances = [plant.GetModelInstanceByName(name) for name in names]
    masses = [
        plant.CalcTotalMass(plant.CreateDefaultContext(), [instance])
        for instance in instances
    ]
    assert masses[-1] == pytest.approx(0.072)
    assert 0.3 < sum(masses) < 1.0


def test_camera_has_the_size_of_the_real_one():
    plant = loaded(MultibodyPlant(0.0), REALSENSE_D415)
    case = mesh(REALSENSE_D415.parent / "realsense.obj")
    np.testing.assert_allclose(case.extents, (0.099, 0.023, 0.02005), atol=8e-4)
    X_BC = relative(plant, "optical", "realsense")
    assert X_BC.rotation().IsNearlyIdentity(1e-12)
    # The colour camera is 35 mm to the left of the middle, as it looks out.
    np.testing.assert_allclose(X_BC.translation(), (-0.035, 0, 0), atol=1e-12)


def test_camera_looks_where_the_cup_goes():
    plant = loaded(MultibodyPlant(0.0), WITH_TOOLS)
    X_TC = relative(plant, "optical", "arm_left_link_tool0")
    ahead = X_TC.multiply([0.0, 0.0, 0.45])
    np.testing.assert_allclose(ahead[:2], (0, 0), atol=1e-8)
    # Far enough beyond the lip for the camera to measure.
    X_TG = relative(plant, "cup", "arm_left_link_tool0")
    assert ahead[2] - X_TG.translation()[2] > 0.3
    # Image up is away from the tool.
    np.testing.assert_allclose(X_TC.rotation().matrix()[:, 0], (0, 1, 0), atol=1e-9)
    assert X_TC.rotation().matrix()[0, 1] < -0.9


def labels_seen_by_the_camera() -> tuple[MultibodyPlant, np.ndarray]:
    """The label image of the wrist camera, with nothing but the robot in the world."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    scene_graph.AddRenderer("vtk", MakeRenderEngineVtk(RenderEngineVtkParams()))
    loaded(plant, WITH_TOOLS)
    context = builder.Build().CreateDefaultContext()
    camera = RenderCameraCore(
        "vtk",
        CameraInfo(640, 480, 615.0, 615.0, 320.0, 240.0),
        ClippingRange(0.01, 10.0),
        RigidTransform(),
    )
    frame = plant.GetFrameByName("optical")
    X_WC = frame.CalcPoseInWorld(plant.GetMyContextFromRoot(context))
    query = scene_graph.get_query_output_port().Eval(
        scene_graph.GetMyContextFromRoot(context)
    )
    image = query.RenderLabelImage(
        ColorRenderCamera(camera), scene_graph.world_frame_id(), X_WC
    )
    return plant, np.array(image.data[:, :, 0])


def test_cup_shows_at_the_edge_of_the_image_at_most():
    plant, labels = labels_seen_by_the_camera()
    gripper = plant.GetModelInstanceByName("suction_gripper")
    seen = np.isin(labels, [int(i) for i in plant.GetBodyIndices(gripper)])
    rows = np.flatnonzero(seen.any(axis=1))
    assert rows.size
    assert rows.min() > 455
    assert seen.mean() < 0.01
    others = labels[~seen]
    assert np.all(others >= 32764)  # empty space


def test_tools_touch_nothing_and_are_checked_against_the_robot():
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    loaded(plant, WITH_TOOLS)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    query_context = scene_graph.GetMyContextFromRoot(context)
    query = scene_graph.get_query_output_port().Eval(query_context)
    assert not query.HasCollisions()
    q = np.zeros(15)
    q[[2, 4, 6]] = np.deg2rad([-60, 120, 60])
    plant.SetPositions(plant.GetMyMutableContextFromRoot(context), q)
    query = scene_graph.get_query_output_port().Eval(query_context)
    inspector = query.inspector()
    touching = {
        inspector.GetName(geometry)
        for pair in query.ComputePointPairPenetration()
        for geometry in (pair.id_A, pair.id_B)
    }
    assert {name for name in touching if "suction_gripper::" in name}


def test_program_makes_the_files_that_are_here(tmp_path: Path):
    gripper, camera = tmp_path / "gripper", tmp_path / "camera"
    gripper.mkdir()
    camera.mkdir()
    make_tools(gripper, camera)
    for made, kept in (
        (gripper, SUCTION_GRIPPER.parent),
        (camera, REALSENSE_D415.parent),
    ):
        assert len(list(made.iterdir())) == 3
        for path in made.iterdir():
            words, here = (
                path.read_text().split(),
                (kept / path.name).read_text().split(),
            )
            assert len(words) == len(here)
            for a, b in zip(words, here, strict=True):
                # The last digit is the processor's.
                assert a == b or float(a) == pytest.approx(float(b), abs=0.011)
