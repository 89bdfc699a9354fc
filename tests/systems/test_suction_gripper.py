# SPDX-License-Identifier: MIT
from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import Box, Cylinder, ProximityProperties, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from physim_drake import models
from physim_drake.errors import InputError
from physim_drake.poses import rotation_angle
from physim_drake.suction.contact import add_cup_geometry
from physim_drake.suction.cup import SuctionConfig
from physim_drake.systems.suction_gripper import SuctionGripper
from tests.systems.gantry import Gantry, contact

CUP = SuctionConfig()
BLOCK = Box(0.08, 0.06, 0.05)
TOP = 0.05
PRESS = 0.002


def block_gantry(mass: float = 0.3, **options: Any) -> Gantry:
    """A block on the table, the cup above its middle, the valve closed."""
    gantry = Gantry([(BLOCK, mass)], **options)
    gantry.put(0, RigidTransform([0.0, 0.0, TOP / 2]))
    gantry.put_cup(0.0, TOP + 0.01)
    return gantry


def pick(gantry: Gantry, top: float = TOP, x: float = 0.0, turn: float = 0.0) -> None:
    """Opens the valve and presses the cup on; leaves it there."""
    gantry.switch(True)
    gantry.move(x, top - PRESS, turn, time=0.2)
    gantry.wait(0.2)


def held_block(mass: float = 0.3, **options: Any) -> Gantry:
    """The cup holds the block 0.3 m above the table."""
    gantry = block_gantry(mass, **options)
    pick(gantry)
    gantry.move(0.0, TOP + 0.3, time=0.8)
    gantry.wait(0.1)
    assert gantry.read("holding") == 1
    return gantry


def drift(gantry: Gantry, X_GO: RigidTransform) -> tuple[float, float]:
    """How far object 0 has moved in the cup, m and rad."""
    X = X_GO.inverse() @ gantry.X_GO()
    return (
        float(np.linalg.norm(X.translation())),
        float(rotation_angle(X.rotation().matrix())),
    )


@pytest.mark.parametrize(
    ("approximation", "time_step"),
    [("lagged", 0.005), ("lagged", 0.002), ("sap", 0.005)],
)
def test_a_box_is_held_through_lift_and_swing(
    approximation: str, time_step: float
) -> None:
    gantry = block_gantry(approximation=approximation, time_step=time_step)
    pick(gantry)
    assert gantry.read("vacuum") > 0.9
    begin = gantry.X_GO()
    gantry.move(0.0, TOP + 0.3, time=0.8)
    for x, turn in ((0.3, 0.0), (-0.3, 0.6), (0.3, -0.6), (0.0, 0.0)):
        gantry.move(x, TOP + 0.3, turn, time=0.8)
        moved, turned = drift(gantry, begin)
        assert moved < 0.002
        assert turned < math.radians(2)
    assert gantry.read("holding") == 1
    assert gantry.X_WO().translation()[2] == pytest.approx(0.325, abs=0.01)


def test_the_sensor_tells_a_seal_from_none_and_nothing_is_picked_from_afar() -> None:
    gantry = block_gantry()
    gantry.switch(True)
    gantry.move(0.0, TOP + CUP.lip_reach + 0.001, time=0.2)
    gantry.wait(0.3)
    assert gantry.read("vacuum") < 0.3
    assert gantry.read("holding") == 0
    gantry.move(0.0, TOP + 0.3, time=0.5)
    assert gantry.X_WO().translation()[2] == pytest.approx(TOP / 2, abs=1e-3)


def test_the_sensor_rises_within_tenths_of_a_second() -> None:
    gantry = block_gantry()
    gantry.put_cup(0.0, TOP - PRESS)
    gantry.wait(0.1)
    assert gantry.read("vacuum") == 0
    gantry.switch(True)
    gantry.wait(0.02)
    assert 0.2 < gantry.read("vacuum") < 0.6
    gantry.wait(0.13)
    assert gantry.read("vacuum") > 0.9


def test_half_a_lip_over_an_edge_holds_nothing() -> None:
    gantry = block_gantry()
    gantry.put_cup(0.04, TOP + 0.01)
    pick(gantry, x=0.04)
    assert gantry.read("vacuum") < 0.3
    gantry.move(0.04, TOP + 0.3, time=0.5)
    assert gantry.read("holding") == 0
    assert gantry.X_WO().translation()[2] < 0.06


@pytest.mark.parametrize(("tilt_deg", "seals"), [(8, True), (25, False)])
def test_a_cup_seals_on_a_slight_tilt_only(tilt_deg: float, seals: bool) -> None:
    gantry = Gantry([(Box(0.15, 0.15, TOP), 0.5)])
    gantry.put(0, RigidTransform([0.0, 0.0, TOP / 2]))
    turn = math.radians(tilt_deg)
    gantry.put_cup(0.0, TOP + 0.02, turn)
    gantry.switch(True)
    # Pressed until the lip's upper side arrives.
    gantry.move(0.0, TOP - CUP.lip_radius * math.sin(turn), turn, time=0.3)
    gantry.wait(0.2)
    assert (gantry.read("vacuum") > 0.9) == seals
    gantry.move(0.0, TOP + 0.3, turn, time=0.8)
    assert gantry.read("holding") == seals
    assert (gantry.X_WO().translation()[2] > 0.2) == seals


@pytest.mark.parametrize(
    ("shape", "radius", "seals"),
    [(Cylinder(0.05, 0.12), 0.05, True), (Sphere(0.018), 0.018, False)],
)
def test_a_large_cylinder_is_lifted_and_a_small_ball_is_not(
    shape: Any, radius: float, seals: bool
) -> None:
    gantry = Gantry([(shape, 0.3)])
    lying = RotationMatrix.MakeXRotation(math.pi / 2)
    gantry.put(0, RigidTransform(lying, [0.0, 0.0, radius]))
    gantry.put_cup(0.0, 2 * radius + 0.01)
    pick(gantry, 2 * radius)
    assert (gantry.read("vacuum") > 0.9) == seals
    gantry.move(0.0, 2 * radius + 0.3, time=0.8)
    gantry.wait(0.2)
    assert (gantry.X_WO().translation()[2] > 0.3) == seals


@pytest.mark.parametrize(("mass", "lifted"), [(3.2, True), (4.0, False)])
def test_what_is_heavier_than_the_vacuum_pulls_stays(mass: float, lifted: bool) -> None:
    assert (mass * 9.81 < CUP.max_force) == lifted
    gantry = block_gantry(mass)
    pick(gantry)
    gantry.move(0.0, TOP + 0.2, time=1.5)
    gantry.wait(0.1)
    assert (gantry.X_WO().translation()[2] > 0.2) == lifted
    assert gantry.read("holding") == lifted
    assert (gantry.read("vacuum") > 0.9) == lifted


@pytest.mark.parametrize(("time", "kept"), [(1.0, True), (0.3, False)])
def test_lifting_too_fast_drops(time: float, kept: bool) -> None:
    mass, lift = 1.5, 0.3
    peak = 5.77 * lift / time**2  # acceleration of the smooth move
    assert (mass * (9.81 + peak) < CUP.max_force) == kept
    gantry = block_gantry(mass)
    pick(gantry)
    gantry.move(0.0, TOP + lift, time=time)
    gantry.wait(0.5)
    assert gantry.read("holding") == kept
    assert (gantry.X_WO().translation()[2] > 0.2) == kept


def test_a_held_object_driven_against_a_wall_comes_off() -> None:
    gantry = held_block(wall=0.1)
    begin = gantry.X_GO()
    gantry.move(0.055, TOP + 0.3, time=0.5)
    assert drift(gantry, begin)[0] < 0.002
    gantry.move(0.15, TOP + 0.3, time=1.0)
    gantry.wait(0.5)
    assert gantry.read("holding") == 0
    assert gantry.X_WO().translation()[2] < 0.1


def test_a_touch_of_the_wall_shifts_the_object_and_does_not_lose_it() -> None:
    gantry = held_block(wall=0.1)
    begin = gantry.X_GO()
    gantry.move(0.065, TOP + 0.3, time=0.5)
    gantry.move(0.0, TOP + 0.3, time=0.5)
    assert gantry.read("holding") == 1
    assert 0.001 < drift(gantry, begin)[0] < 0.01


@pytest.mark.parametrize("approximation", ["lagged", "sap"])
def test_a_closed_valve_lets_go_and_the_object_comes_to_rest(
    approximation: str,
) -> None:
    gantry = held_block(approximation=approximation)
    gantry.move(0.0, TOP + 0.05, time=0.5)
    gantry.switch(False)
    gantry.wait(0.1)
    assert gantry.read("holding") == 0
    gantry.wait(0.9)
    assert gantry.read("vacuum") == 0
    assert gantry.X_WO().translation()[2] == pytest.approx(TOP / 2, abs=1e-3)
    assert gantry.speed() < 0.01


RADIUS, FULL = CUP.lip_radius, CUP.max_force
ARM = TOP / 2 - CUP.stroke  # of the block's middle below the collapsed lip


@pytest.mark.parametrize(
    ("force", "torque", "limit"),
    [
        ([0, 0, -1], [0, 0, 0], FULL - 0.3 * 9.81),
        ([1, 0, 0], [0, ARM, 0], CUP.friction * FULL),  # in the lip's plane
        ([0, 0, 0], [0, 1, 0], FULL * RADIUS / 2),
    ],
    ids=["tension", "shear", "bending"],
)
def test_a_load_beyond_the_limit_pulls_it_off(
    force: list[float], torque: list[float], limit: float
) -> None:
    gantry = held_block()

    def load_up_to(share: float) -> None:
        for s in np.linspace(share - 0.3, share, 30):
            if gantry.read("holding"):
                load = s * limit
                gantry.push(load * np.array(force), tau_W=load * np.array(torque))
                gantry.wait(0.01)

    load_up_to(0.85)
    gantry.wait(0.2)
    assert gantry.read("holding") == 1
    load_up_to(1.2)
    assert gantry.read("holding") == 0


@pytest.mark.parametrize(("share", "slips"), [(0.7, False), (1.3, True)])
def test_a_twist_turns_it_beyond_the_friction_of_a_disc(
    share: float, slips: bool
) -> None:
    limit = 2 / 3 * CUP.friction * FULL * RADIUS
    gantry = held_block()
    begin = gantry.X_GO()
    for s in np.linspace(0, share, 30):
        gantry.push(tau_W=[0, 0, s * limit])
        gantry.wait(0.01)
    assert (drift(gantry, begin)[1] > math.radians(5)) == slips


@pytest.mark.parametrize("time_step", [0.002, 0.005])
def test_a_light_object_stays_still(time_step: float) -> None:
    size = (0.05, 0.05, 0.03)
    gantry = Gantry([(Box(*size), 0.03)], time_step=time_step)
    gantry.put(0, RigidTransform([0.0, 0.0, size[2] / 2]))
    gantry.put_cup(0.0, size[2] + 0.01)
    pick(gantry, size[2])
    gantry.move(0.0, 0.3, time=0.5)
    gantry.wait(0.3)
    begin = gantry.X_GO()
    gantry.wait(0.5)
    assert gantry.speed() < 1e-3
    assert drift(gantry, begin)[0] < 1e-4


def test_the_bundled_gripper_lifts_a_box() -> None:
    folder = Path(models.__file__).parent / "suction_gripper"
    gantry = held_block(tool=folder / "suction_gripper.sdf")
    begin = gantry.X_GO()
    gantry.move(0.2, TOP + 0.3, time=0.6)
    assert drift(gantry, begin)[0] < 0.002
    assert gantry.X_WO().translation()[2] > 0.3


def test_only_the_object_under_the_cup_is_picked() -> None:
    gantry = Gantry([(BLOCK, 0.3), (BLOCK, 0.3)])
    gantry.put(0, RigidTransform([0.0, 0.0, TOP / 2]))
    gantry.put(1, RigidTransform([0.085, 0.0, TOP / 2]))
    gantry.put_cup(0.0, TOP + 0.01)
    pick(gantry)
    gantry.move(0.0, TOP + 0.2, time=0.6)
    assert gantry.X_WO(0).translation()[2] > 0.2
    assert gantry.X_WO(1).translation()[2] == pytest.approx(TOP / 2, abs=1e-3)


def test_a_table_fools_the_sensor() -> None:
    gantry = block_gantry()
    gantry.put_cup(0.3, 0.01)
    pick(gantry, 0.0, x=0.3)
    assert gantry.read("holding") == 1


def test_a_cloned_context_goes_on_as_the_original() -> None:
    gantry = held_block()
    gantry.push([4.0, 1.0, 0.0])
    clone = gantry.root.Clone()
    finals = []
    for root in (gantry.root, clone):
        simulator = Simulator(gantry.diagram, root)
        simulator.AdvanceTo(root.get_time() + 0.3)
        finals.append(
            np.concatenate(
                [
                    root.get_discrete_state(n).value()
                    for n in range(root.num_discrete_state_groups())
                ]
            )
        )
    np.testing.assert_array_equal(*finals)


def test_without_vacuum_there_are_no_forces() -> None:
    gantry = block_gantry()
    gantry.put_cup(0.0, TOP - PRESS)
    gantry.wait(0.1)
    context = gantry.gripper.GetMyContextFromRoot(gantry.root)
    assert gantry.gripper.spatial_forces_output_port().Eval(context) == []
    gantry.switch(True)
    gantry.wait(0.2)
    forces = gantry.gripper.spatial_forces_output_port().Eval(context)
    total = sum(force.F_Bq_W.translational() for force in forces)
    np.testing.assert_allclose(total, 0, atol=1e-9)
    pull = forces[0].F_Bq_W.translational()
    np.testing.assert_allclose(pull, [0, 0, FULL], rtol=0.02, atol=0.1)


@pytest.mark.parametrize(
    ("contact_model", "object_properties", "cup", "message"),
    [
        ("point", contact(), True, "contact_model: a cup needs a patch"),
        ("hydroelastic", ProximityProperties(), True, "block: .* not hydroelastic"),
        ("hydroelastic", contact(), False, "cup: .* not compliant hydroelastic"),
    ],
)
def test_contact_that_could_not_hold_is_refused(
    contact_model: str, object_properties: ProximityProperties, cup: bool, message: str
) -> None:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(contact_model=contact_model), builder
    )
    inertia = SpatialInertia.SolidSphereWithMass(0.1, 0.1)
    block, gripper = (plant.AddRigidBody(name, inertia) for name in ("block", "cup"))
    plant.RegisterCollisionGeometry(
        block, RigidTransform(), BLOCK, "block", object_properties
    )
    if cup:
        add_cup_geometry(plant, gripper, RigidTransform(), CUP)
    plant.Finalize()
    with pytest.raises(InputError, match=message):
        SuctionGripper.AddToBuilder(
            builder, CUP, plant, scene_graph, gripper.body_frame(), [block]
        )
