# SPDX-License-Identifier: MIT
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from pydrake.geometry import Box, CollisionFilterDeclaration, Cylinder
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.parsing import (
    LoadModelDirectives,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from physim_drake.models import PACKAGE_XML, SDA10F
from physim_drake.models.make_sda10f import make_robot

# Origin xyz and rpy of each joint in its parent, its axis, and its limit and speed in
# degrees; the maker's model of the machine, read off joint by joint.
LEFT = [
    ((0.1, 0.265, 0.0), (np.pi / 2, 0, 0), (0, 0, -1), 180, 170),
    ((0, 0, 0), (-np.pi / 2, 0, 0), (0, 0, -1), 110, 170),
    ((0, 0.36, 0), (np.pi / 2, 0, 0), (0, 0, -1), 170, 170),
    ((0, 0, 0), (-np.pi / 2, 0, 0), (0, 0, 1), 135, 170),
    ((0, 0.36, 0), (np.pi / 2, 0, 0), (0, 0, 1), 180, 200),
    ((0, 0, 0), (-np.pi / 2, 0, 0), (0, 0, 1), 110, 200),
    ((0, 0.155, 0), (-np.pi / 2, 0, 0), (0, 0, -1), 180, 400),
]
RIGHT = [
    ((0.1, -0.265, 0.0), (np.pi / 2, 0, -np.pi), (0, 0, 1), 180, 170),
    ((0, 0, 0), (-np.pi / 2, 0, 0), (0, 0, 1), 110, 170),
    ((0, 0.36, 0), (np.pi / 2, 0, 0), (0, 0, 1), 170, 170),
    ((0, 0, 0), (-np.pi / 2, 0, 0), (0, 0, -1), 135, 170),
    ((0, 0.36, 0), (np.pi / 2, 0, 0), (0, 0, -1), 180, 200),
    ((0, 0, 0), (-np.pi / 2, 0, 0), (0, 0, -1), 110, 200),
    ((0, 0.155, 0), (-np.pi / 2, 0, 0), (0, 0, 1), 180, 400),
]
AXES = ("1_s", "2_l", "3_e", "4_u", "5_r", "6_b", "7_t")
TORSO_HEIGHT, TORSO_LIMIT, TORSO_SPEED = 1.2, 170, 130

# Least and greatest x, y, z of the links, and the volumes (dm^3) of their hulls.
BOXES = {
    "torso_base_link": ((-0.343, -0.25, -1.2), (0.157, 0.25, -0.307), 116.9),
    "torso_link_b1": ((-0.122, -0.129, -0.32), (0.222, 0.129, 0.139), 25.57),
    "link_1_s": ((-0.087, -0.105, -0.085), (0.086, 0.085, 0.175), 6.15),
    "link_2_l": ((-0.092, -0.092, -0.066), (0.091, 0.216, 0.1), 4.48),
    "link_3_e": ((-0.068, -0.068, -0.066), (0.068, 0.085, 0.181), 3.43),
    "link_4_u": ((-0.071, -0.07, -0.08), (0.07, 0.239, 0.055), 3.02),
    "link_5_r": ((-0.059, -0.073, -0.055), (0.058, 0.057, 0.155), 2.14),
    "link_6_b": ((-0.058, -0.057, -0.055), (0.057, 0.155, 0.073), 1.72),
    "link_7_t": ((-0.04, -0.04, -0.014), (0.04, 0.04, 0.0), 0.06),
}
CHAINS = [
    ["torso_base_link", "torso_link_b1", *(f"arm_{side}_link_{n}" for n in AXES)]
    for side in ("left", "right")
]
PAYLOAD = 10.0  # kg


@dataclass(frozen=True)
class Robot:
    plant: MultibodyPlant
    scene_graph: Any
    context: Any

    @property
    def plant_context(self) -> Any:
        return self.plant.GetMyMutableContextFromRoot(self.context)

    def put(self, q: np.ndarray) -> None:
        self.plant.SetPositions(self.plant_context, q)

    def query(self) -> Any:
        context = self.scene_graph.GetMyContextFromRoot(self.context)
        return self.scene_graph.get_query_output_port().Eval(context)

    def contacts(self) -> set[tuple[str, str]]:
        inspector = self.scene_graph.model_inspector()
        pairs = set()
        for pair in self.query().ComputePointPairPenetration():
            bodies = [
                self.plant.GetBodyFromFrameId(inspector.GetFrameId(geometry)).name()
                for geometry in (pair.id_A, pair.id_B)
            ]
            pairs.add((min(bodies), max(bodies)))
        return pairs

    def pose(self, frame: str) -> RigidTransform:
        return self.plant.GetFrameByName(frame).CalcPoseInWorld(self.plant_context)

    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        return self.plant.GetPositionLowerLimits(), self.plant.GetPositionUpperLimits()


def load(file: str) -> Robot:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    parser = Parser(plant)
    parser.package_map().AddPackageXml(str(PACKAGE_XML))
    ProcessModelDirectives(LoadModelDirectives(str(SDA10F / file)), parser)
    plant.Finalize()
    return Robot(plant, scene_graph, builder.Build().CreateDefaultContext())


@pytest.fixture(scope="module", name="robot")
def fixture_robot() -> Robot:
    return load("motoman_sda10f.dmd.yaml")


def chain_product(rows: list, torso: float, q: np.ndarray) -> np.ndarray:
    """X of tool0 in base_link, (4, 4), by the table."""

    def turn(axis, angle: float) -> np.ndarray:
        x, y, z = axis
        K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        X = np.eye(4)
        X[:3, :3] += np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
        return X

    X = np.eye(4)
    X[2, 3] = TORSO_HEIGHT
    X = X @ turn((0, 0, 1), torso)
    for (xyz, rpy, axis, _, _), angle in zip(rows, q, strict=True):
        roll, pitch, yaw = rpy
        origin = turn((0, 0, 1), yaw) @ turn((0, 1, 0), pitch) @ turn((1, 0, 0), roll)
        origin[:3, 3] = xyz
        X = X @ origin @ turn(axis, angle)
    return X @ turn((0, 0, 1), np.pi)


def test_tools_are_where_they_belong_at_zero(robot: Robot):
    robot.put(np.zeros(15))
    for side, sign in (("left", 1), ("right", -1)):
        X = robot.pose(f"arm_{side}_link_tool0")
        np.testing.assert_allclose(X.translation(), (0.1, sign * 1.14, 1.2), atol=1e-9)
        np.testing.assert_allclose(X.rotation().matrix()[:, 2], (0, sign, 0), atol=1e-9)


def test_forward_kinematics_agrees_with_the_table(robot: Robot):
    rng = np.random.default_rng(3)
    for q in rng.uniform(*robot.limits(), (40, 15)):
        robot.put(q)
        for side, rows, joints in (("left", LEFT, q[1:8]), ("right", RIGHT, q[8:])):
            X = robot.pose(f"arm_{side}_link_tool0").GetAsMatrix4()
            np.testing.assert_allclose(X, chain_product(rows, q[0], joints), atol=1e-6)


def test_joints_are_driven_and_limited_as_in_the_table(robot: Robot):
    plant = robot.plant
    assert plant.num_actuators() == plant.num_positions() == 15
    names = ["torso_joint_b1"] + [
        f"arm_{side}_joint_{axis}" for side in ("left", "right") for axis in AXES
    ]
    expected = [(TORSO_LIMIT, TORSO_SPEED), *(row[3:] for row in LEFT + RIGHT)]
    for n, (name, (limit, speed)) in enumerate(zip(names, expected, strict=True)):
        joint = plant.GetJointByName(name)
        assert joint.position_start() == n
        assert np.rad2deg(joint.position_upper_limit()) == pytest.approx(limit)
        assert np.rad2deg(joint.position_lower_limit()) == pytest.approx(-limit)
        assert np.rad2deg(joint.velocity_upper_limit()) == pytest.approx(speed)
        assert 3 < joint.acceleration_upper_limit() < 30
        actuator = plant.GetJointActuatorByName(name)
        assert 0 < actuator.effort_limit() < 500
        # Motors of this size turn at 3000 to 6000 turns a minute.
        motor = joint.velocity_upper_limit() * actuator.default_gear_ratio()
        assert 3000 < motor * 60 / (2 * np.pi) < 6000


def test_mass_is_the_machines_and_lies_within_the_links(robot: Robot):
    plant, context = robot.plant, robot.plant_context
    assert plant.CalcTotalMass(context) == pytest.approx(220.0, abs=0.1)
    for name, body in bodies(robot):
        inertia = body.default_spatial_inertia()
        assert inertia.IsPhysicallyValid()
        lower, upper, _ = BOXES[name]
        assert np.all(inertia.get_com() > lower)
        assert np.all(inertia.get_com() < upper)
        # No link is heavier about its middle than a shell of its size could be.
        radii = np.sqrt(
            inertia.Shift(inertia.get_com()).get_unit_inertia().get_moments()
        )
        assert np.all(radii < np.linalg.norm(np.subtract(upper, lower)) / 2)
    arm = sum(
        plant.GetBodyByName(f"arm_left_link_{axis}").default_mass() for axis in AXES
    )
    # An SIA10F without its base.
    assert arm == pytest.approx(43.5, abs=0.1)


def bodies(robot: Robot):
    """Names in `BOXES` and bodies."""
    for chain in CHAINS:
        for body_name in chain:
            name = re.sub("arm_(left|right)_", "", body_name)
            yield name, robot.plant.GetBodyByName(body_name)


def test_drives_lift_the_payload_and_accelerate_it():
    plant = MultibodyPlant(0.0)
    (instance,) = Parser(plant).AddModels(str(SDA10F / "motoman_sda10f.urdf"))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base_link"))
    for side in ("left", "right"):
        ball = SpatialInertia.SolidSphereWithMass(PAYLOAD, 0.08)
        load = plant.AddRigidBody(f"load_{side}", instance, ball)
        tool = plant.GetFrameByName(f"arm_{side}_link_tool0")
        plant.WeldFrames(tool, load.body_frame(), RigidTransform([0, 0, 0.08]))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    lower, upper = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
    rng = np.random.default_rng(0)
    held, moved = np.zeros(15), np.zeros(15)
    for n in range(3000):
        # Every second posture is one of right angles: the worst ones are.
        angles = rng.integers(-1, 2, 15) * np.pi / 2
        q = rng.uniform(lower, upper) if n % 2 else angles.clip(lower, upper)
        plant.SetPositions(context, q)
        gravity = abs(plant.CalcGravityGeneralizedForces(context))
        inertia = np.diag(plant.CalcMassMatrix(context))
        held = np.maximum(held, gravity)
        moved = np.maximum(
            moved, gravity + inertia * plant.GetAccelerationUpperLimits()
        )
    efforts = plant.GetEffortUpperLimits()
    assert np.all(moved < efforts)
    assert np.all(efforts[[1, 2, 3, 4]] > 1.8 * held[[1, 2, 3, 4]])
    assert held[1] > 150  # the postures were bad ones


POSTURES = {
    "arms out": np.zeros(15),
    "arms down": [0] + [-np.pi / 2, -np.pi / 2, 0, 0, 0, 0, 0] * 2,
    "arms ahead": [0, *([0, -np.pi / 2, 0, 0, 0, 0, 0] * 2)],
    "elbows bent": [
        0,
        0.9,
        1.2,
        0.6,
        1.9,
        0.3,
        0.7,
        0,
        0.9,
        1.2,
        0.6,
        1.9,
        0.3,
        0.7,
        0,
    ],
    "left arm over a table": [
        0.0,
        *(2.222, -1.238, 0.887, 1.444, -0.636, 1.353, 0.596),
        *(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    ],
}


@pytest.mark.parametrize("posture", POSTURES)
def test_postures_at_work_touch_nothing(robot: Robot, posture: str):
    robot.put(np.asarray(POSTURES[posture], dtype=float))
    assert robot.contacts() == set()


def test_hand_in_the_torso_is_reported(robot: Robot):
    q = np.zeros(15)
    q[[2, 4]] = np.deg2rad([-60, 130])
    robot.put(q)
    assert robot.contacts() & {
        ("arm_left_link_6_b", "torso_link_b1"),
        ("arm_left_link_5_r", "torso_link_b1"),
    }


def test_crossed_arms_are_reported(robot: Robot):
    q = np.zeros(15)
    q[[1, 8]] = np.pi / 2
    for angle in np.deg2rad(np.linspace(0, 110, 12)):
        q[[2, 9]] = angle
        for bend in np.deg2rad(np.linspace(-130, 130, 14)):
            q[[4, 11]] = bend
            robot.put(q)
            if any("left" in a and "right" in b for a, b in robot.contacts()):
                return
    pytest.fail("no two links of different arms ever touch")


def test_links_that_are_not_checked_cannot_touch():
    """Beyond what turns on a common joint, which touches by its nature."""
    robot = load("motoman_sda10f.dmd.yaml")
    context = robot.scene_graph.GetMyMutableContextFromRoot(robot.context)
    manager = robot.scene_graph.collision_filter_manager(context)
    inspector = robot.query().inspector()
    pairs = []
    for chain in CHAINS:
        for a, b in zip(chain[:-2], chain[2:], strict=True):
            one, other = (geometries(robot, name) for name in (a, b))
            assert inspector.CollisionFiltered(one[0], other[0])
            pairs += [(g, h) for g in one for h in other]
            sets = [
                robot.plant.CollectRegisteredGeometries([robot.plant.GetBodyByName(n)])
                for n in (a, b)
            ]
            manager.Apply(CollisionFilterDeclaration().AllowBetween(*sets))
    lower, upper = robot.limits()
    rng = np.random.default_rng(1)
    least = np.inf
    for _ in range(60):
        ends = rng.choice([0.0, 0.5, 1.0], 15)
        robot.put(lower + ends * (upper - lower))
        query = robot.query()
        least = min(
            least,
            *(query.ComputeSignedDistancePairClosestPoints(*p).distance for p in pairs),
        )
    # The cylinders are a little fatter than the links.
    assert -0.006 < least < 0.02


def geometries(robot: Robot, body: str) -> list:
    return robot.plant.GetCollisionGeometriesForBody(robot.plant.GetBodyByName(body))


def extents(shape: Any, X: RigidTransform) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest x, y, z of a shape at the pose X."""
    R = np.abs(X.rotation().matrix())
    if isinstance(shape, Cylinder):
        along = R[:, 2]
        half = along * shape.length() / 2
        half += shape.radius() * np.sqrt(np.clip(1 - along**2, 0, 1))
    else:
        assert isinstance(shape, Box)
        half = R @ np.array(shape.size()) / 2
    return X.translation() - half, X.translation() + half


def test_collision_shapes_fill_the_boxes_of_the_links(robot: Robot):
    inspector = robot.scene_graph.model_inspector()
    for name, body in bodies(robot):
        ids = robot.plant.GetCollisionGeometriesForBody(body)
        assert len(ids) <= 2
        boxes = [
            extents(inspector.GetShape(g), inspector.GetPoseInFrame(g)) for g in ids
        ]
        lower = np.min([low for low, _ in boxes], axis=0)
        upper = np.max([high for _, high in boxes], axis=0)
        np.testing.assert_allclose(lower, BOXES[name][0], atol=0.007)
        np.testing.assert_allclose(upper, BOXES[name][1], atol=0.007)


def distance(shape: Any, X: RigidTransform, points: np.ndarray) -> np.ndarray:
    """How far points (N, 3) are outside a shape at the pose X."""
    local = np.abs(X.inverse().multiply(points.T).T)
    if isinstance(shape, Cylinder):
        radial = np.linalg.norm(local[:, :2], axis=1) - shape.radius()
        axial = local[:, 2] - shape.length() / 2
        return np.hypot(radial.clip(0), axial.clip(0))
    return np.linalg.norm((local - np.array(shape.size()) / 2).clip(0), axis=1)


def test_what_is_seen_is_the_size_of_the_machine_and_covered(robot: Robot):
    inspector = robot.scene_graph.model_inspector()
    for name, body in bodies(robot):
        lower, upper, volume = BOXES[name]
        mesh = trimesh.load(SDA10F / "meshes" / f"{name}.obj", force="mesh")
        np.testing.assert_allclose(mesh.bounds, (lower, upper), atol=0.016)
        assert np.all(mesh.bounds[0] > np.subtract(lower, 0.004))
        assert np.all(mesh.bounds[1] < np.add(upper, 0.004))
        hull = 1e3 * mesh.convex_hull.volume
        assert hull == pytest.approx(volume, rel=0.2)
        ids = robot.plant.GetCollisionGeometriesForBody(body)
        outside = np.min(
            [
                distance(
                    inspector.GetShape(g), inspector.GetPoseInFrame(g), mesh.vertices
                )
                for g in ids
            ],
            axis=0,
        )
        assert outside.max() < 0.018


def test_heads_beside_each_other_do_not_run_into_each_other():
    """What is seen of a link keeps off the other at its joint, however it turns."""
    turned = RigidTransform(RollPitchYaw(-np.pi / 2, 0, 0), [0, 0, 0])
    for lower, upper in (("1_s", "2_l"), ("3_e", "4_u"), ("5_r", "6_b")):
        sides = []
        for name, X in ((lower, RigidTransform()), (upper, turned)):
            mesh = trimesh.load(SDA10F / "meshes" / f"link_{name}.obj", force="mesh")
            points = X.multiply(mesh.vertices.T).T
            near = np.hypot(points[:, 0], points[:, 2]) < BOXES[f"link_{lower}"][1][0]
            sides.append(points[near, 1])
        (a, b) = (sides[0], sides[1]) if sides[0].mean() < 0 else (sides[1], sides[0])
        assert a.max() < 0.003
        assert b.min() > -0.003


def test_robot_stands_where_its_frame_is_put():
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.0)
    parser = Parser(plant)
    parser.package_map().AddPackageXml(str(PACKAGE_XML))
    file = SDA10F / "motoman_sda10f.dmd.yaml"
    ProcessModelDirectives(LoadModelDirectives(str(file)), parser)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    X_WB = RigidTransform(RotationMatrix.MakeZRotation(0.5), [1.0, 2.0, 0.1])
    plant.GetFrameByName("robot_base").SetPoseInParentFrame(context, X_WB)
    X = plant.GetFrameByName("arm_left_link_tool0").CalcPoseInWorld(context)
    expected = X_WB.multiply([0.1, 1.14, 1.2])
    np.testing.assert_allclose(X.translation(), expected, atol=1e-9)


def test_program_makes_the_files_that_are_here(tmp_path: Path):
    make_robot(tmp_path)
    for path in sorted(tmp_path.rglob("*.*")):
        here = SDA10F / path.relative_to(tmp_path)
        made, kept = path.read_text().split(), here.read_text().split()
        if path.suffix == ".urdf":
            assert made == kept
            continue
        assert len(made) == len(kept)
        for a, b in zip(made, kept, strict=True):
            # The last digit is the processor's.
            assert a == b or float(a) == pytest.approx(float(b), abs=0.011)


def test_meshes_are_small():
    assert sum(path.stat().st_size for path in SDA10F.rglob("*.obj")) < 9e5
