# SPDX-License-Identifier: MIT
"""Plans of the SDA10F in a small cell, judged by a plant of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.parsing import AddModel, ModelDirective

from physim_drake.errors import InputError
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary
from physim_drake.picking.arm_planner import ArmPlanner, PickPlan, drop_pose
from physim_drake.picking.planner_config import (
    ArmPlannerConfig,
    HeldObject,
    PlanFailure,
)
from physim_drake.picking.policy import PickCandidate, TopOfPileFirst
from physim_drake.picking.trajectories import ArmTrajectory
from physim_drake.picking.viewpoints import look_at
from physim_drake.poses import Array, inverse, make_pose, transform_points
from tests.picking.judge import (
    TABLE_HEIGHT,
    Judge,
    cell,
    estimate_of,
    library,
    on_table,
    wall_at,
)
from tests.synthetic import BALL, ERASER, SOAP, TISSUES, resting, stack, turned

DOWN = np.diag([1.0, -1.0, -1.0])
TOOL = ("suction_cup", "suction_gripper")
PERIOD = 0.005
Placed = Sequence[tuple[int, Array]]


@cache
def models() -> ObjectLibrary:
    return library()


@cache
def shared_planner() -> ArmPlanner:
    return ArmPlanner(cell(), models())


@pytest.fixture
def planner() -> ArmPlanner:
    """A planner in an empty cell."""
    shared_planner().set_scene(estimate_of((), models()))
    return shared_planner()


def over_table(x: float, y: float, height: float) -> Array:
    """X_WG of a cup that points down."""
    return make_pose(DOWN, [x, y, TABLE_HEIGHT + height])


def judge(folder: Path, objects: Placed = (), held: HeldObject | None = None) -> Judge:
    return Judge(objects, models(), folder, ArmPlannerConfig(), held)


def nearest(judge: Judge, motion: ArmTrajectory) -> dict[tuple[str, str], float]:
    """The smallest distance of each near pair along a motion, m."""
    found: dict[tuple[str, str], float] = {}
    for t in np.arange(0.0, motion.duration + PERIOD, PERIOD):
        for pair, distance in judge.distances(motion.value(float(t))).items():
            found[pair] = min(found.get(pair, np.inf), distance)
    return found


def assert_clear(near: dict[tuple[str, str], float], touching: str = "") -> None:
    """The robot keeps 1 cm, its slender tool 3 mm; a bit less between two checks."""
    for (body, other), distance in near.items():
        if other == touching and body in TOOL:
            continue
        slender = body in TOOL
        assert distance > (0.002 if slender else 0.008), (body, other, distance)


def assert_within_limits(motion: ArmTrajectory, share: float = 1.0) -> None:
    plant = shared_planner().scene.plant
    config = ArmPlannerConfig()
    joints = [plant.GetJointByName(name) for name in motion.joints]
    limits = [
        np.array([float(getter(j)[0]) for j in joints])
        for getter in (
            lambda j: j.position_lower_limits(),
            lambda j: j.position_upper_limits(),
            lambda j: j.velocity_upper_limits(),
            lambda j: j.acceleration_upper_limits(),
        )
    ]
    times = np.arange(0.0, motion.duration, 1e-3)
    q = motion.value(times)
    assert (q > limits[0]).all()
    assert (q < limits[1]).all()
    v = np.diff(q, axis=0) / 1e-3
    assert (np.abs(v) <= 1.001 * share * config.speed * limits[2]).all()
    a = np.diff(v, axis=0) / 1e-3
    assert (np.abs(a) <= 1.01 * share * config.acceleration * limits[3]).all()
    ends = np.array([0.0, motion.duration])
    np.testing.assert_allclose(motion.velocity(ends), 0, atol=1e-12)
    # The motion's own velocity is that of its positions.
    middle = times[:-1] + 5e-4
    np.testing.assert_allclose(motion.velocity(middle), v, atol=1e-3)


def test_a_pose_above_the_table_is_reached(planner: ArmPlanner, tmp_path: Path) -> None:
    independent = judge(tmp_path)
    for x, y in ((0.5, 0.0), (0.6, 0.3), (0.7, 0.4)):
        X_WG = over_table(x, y, 0.1)
        q = planner.solve_ik(X_WG, planner.home)
        X = independent.pose("cup", q)
        np.testing.assert_allclose(X[:3, 3], X_WG[:3, 3], atol=1e-5)
        np.testing.assert_allclose(X[:3, 2], [0, 0, -1], atol=1e-5)
        assert planner.scene.within_limits(q)
        assert_clear(independent.distances(q))


def test_a_turn_is_kept_where_it_is_not_free(planner: ArmPlanner) -> None:
    X_WG = over_table(0.6, 0.2, 0.1) @ make_pose(turned("z", 70))
    q = planner.solve_ik(X_WG, planner.home, free_turn=False)
    np.testing.assert_allclose(planner.scene.tool_pose(q), X_WG, atol=1e-5)


def test_what_is_out_of_reach_is_said_to_be(planner: ArmPlanner) -> None:
    with pytest.raises(PlanFailure, match=r"limits reaches the cup's pose at \[3.0"):
        planner.solve_ik(over_table(3.0, 0.0, 0.1), planner.home)


def test_what_is_in_the_table_is_said_to_touch_it(planner: ArmPlanner) -> None:
    with pytest.raises(PlanFailure, match=r"no collision-free .* table::body") as info:
        planner.solve_ik(over_table(0.6, 0.2, -0.02), planner.home)
    assert info.value.stage == "ik"


def test_a_free_motion_is_straight_and_within_limits(
    planner: ArmPlanner, tmp_path: Path
) -> None:
    goal = planner.solve_ik(over_table(0.65, 0.0, 0.1), planner.home)
    motion = planner.plan_to(planner.home, goal)
    np.testing.assert_allclose(motion.start, planner.home, atol=1e-9)
    np.testing.assert_allclose(motion.end, goal, atol=1e-9)
    along = motion.q - planner.home
    whole = goal - planner.home
    share = along @ whole / (whole @ whole)
    np.testing.assert_allclose(along, share[:, None] * whole, atol=1e-6)
    assert_within_limits(motion)
    assert_clear(nearest(judge(tmp_path), motion))
    np.testing.assert_allclose(motion.value(motion.duration + 1), goal, atol=1e-9)
    drake = motion.to_drake()
    t = 0.37 * motion.duration
    np.testing.assert_allclose(drake.value(t)[:, 0], motion.value(t), atol=1e-9)


def test_a_wall_in_between_is_gone_around(planner: ArmPlanner, tmp_path: Path) -> None:
    start = planner.solve_ik(over_table(0.6, 0.0, 0.08), planner.home)
    goal = planner.solve_ik(over_table(0.6, 0.4, 0.08), start)
    walls = [wall_at(0.6, 0.2)]
    independent = judge(tmp_path, walls)
    straight = start + np.linspace(0, 1, 100)[:, None] * (goal - start)
    through = min(d for q in straight for d in independent.distances(q).values())
    assert through < -0.005
    planner.set_scene(estimate_of(walls, models()))
    motion = planner.plan_to(start, goal)
    np.testing.assert_allclose(motion.end, goal, atol=1e-9)
    assert_clear(nearest(independent, motion))
    assert_within_limits(motion)


def test_a_goal_in_a_wall_is_refused(planner: ArmPlanner) -> None:
    goal = planner.solve_ik(over_table(0.6, 0.3, 0.1), planner.home)
    planner.set_scene(estimate_of([wall_at(0.6, 0.3)], models()))
    with pytest.raises(PlanFailure, match=r"at the goal, too near are .*wall") as info:
        planner.plan_to(planner.home, goal)
    assert info.value.stage == "transfer"


def test_a_search_that_finds_nothing_ends(
    planner: ArmPlanner, monkeypatch: pytest.MonkeyPatch
) -> None:
    goal = planner.solve_ik(over_table(0.6, 0.3, 0.1), planner.home)
    monkeypatch.setattr(planner.scene, "edge_free", lambda a, b: False)
    with pytest.raises(PlanFailure, match=r"no way around .* in 800 samples"):
        planner.plan_to(planner.home, goal)


def pile() -> list[tuple[int, Array]]:
    """A bar of soap on an eraser, a box and a ball beside them."""
    extra = [
        (TISSUES, resting(TISSUES, turned("z", 20), 0.12, -0.08)),
        (BALL, resting(BALL, np.eye(3), -0.1, 0.08)),
    ]
    return [(i, on_table(X)) for i, X in [*stack(), *extra]]


def best_candidates(objects: Placed) -> tuple[PickCandidate, ...]:
    order = TopOfPileFirst().order(estimate_of(objects, models()), models())
    first: dict[int, PickCandidate] = {}
    for candidate in order:
        first.setdefault(candidate.index, candidate)
    return tuple(first.values())


def planned(planner: ArmPlanner, objects: Placed, index: int) -> PickPlan:
    planner.set_scene(estimate_of(objects, models()))
    candidate = next(c for c in best_candidates(objects) if c.index == index)
    return planner.plan_pick(planner.home, candidate)


@pytest.mark.parametrize("index", [1, 2, 3])
def test_a_pick_presses_the_cup_on_the_object_and_lifts_it(
    planner: ArmPlanner, tmp_path: Path, index: int
) -> None:
    objects = pile()
    plan = planned(planner, objects, index)
    candidate, config = plan.candidate, planner.config
    np.testing.assert_allclose(plan.transfer.start, planner.home, atol=1e-9)
    np.testing.assert_allclose(plan.approach.start, plan.transfer.end, atol=1e-9)
    np.testing.assert_allclose(plan.retreat.start, plan.approach.end, atol=1e-9)
    independent = judge(tmp_path, objects)
    target = models()[candidate.object_id].name
    assert_clear(nearest(independent, plan.transfer))
    assert_clear(nearest(independent, plan.approach), touching=target)

    # The cup comes in along the normal and ends a little beyond contact.
    q = plan.approach.value(np.linspace(0, plan.approach.duration, 50))
    p_WG = np.array([independent.pose("cup", row)[:3, 3] for row in q])
    offsets = p_WG - candidate.X_WG[:3, 3]
    along = offsets @ candidate.approach
    beside = np.linalg.norm(offsets - np.outer(along, candidate.approach), axis=1)
    assert beside.max() < 5e-4
    assert along[0] == pytest.approx(-config.pre_grasp, abs=1e-4)
    assert along[-1] == pytest.approx(candidate.dome + config.press, abs=1e-4)
    assert (np.diff(along) > -1e-6).all()

    # The object is where it was when the cup takes it, and rises straight up.
    X_WG = independent.pose("cup", plan.retreat.start)
    np.testing.assert_allclose(X_WG @ plan.held.X_GO, candidate.X_WO, atol=1e-5)
    end = independent.pose("cup", plan.retreat.end)[:3, 3]
    np.testing.assert_allclose(end - X_WG[:3, 3], [0, 0, config.lift], atol=1e-4)
    for motion, share in ((plan.transfer, 1.0), (plan.approach, 1.0)):
        assert_within_limits(motion, share)
    assert_within_limits(plan.retreat, config.carry)


def test_a_lifted_object_passes_its_neighbours(
    planner: ArmPlanner, tmp_path: Path
) -> None:
    objects = pile()
    plan = planned(planner, objects, 1)
    others = [item for n, item in enumerate(objects) if n != 1]
    independent = judge(tmp_path, others, plan.held)
    start = independent.distances(plan.retreat.start)
    for pair, distance in nearest(independent, plan.retreat).items():
        assert distance > min(start.get(pair, np.inf), 0.003) - 0.002, pair


def test_what_carries_another_object_cannot_be_lifted(planner: ArmPlanner) -> None:
    # The eraser's end sticks out from under the soap, wide enough for the cup.
    lower, (soap_id, X_soap) = stack()
    shifted = make_pose(p=[0.0, 0.035, 0.0]) @ X_soap
    objects = [(i, on_table(X)) for i, X in [lower, (soap_id, shifted)]]
    candidates = [c for c in best_candidates(objects) if c.index == 0]
    assert candidates
    planner.set_scene(estimate_of(objects, models()))
    with pytest.raises(PlanFailure, match="the held expo") as info:
        planner.plan_pick(planner.home, candidates[0])
    assert info.value.stage == "retreat"


def test_the_way_to_the_drop_pose_is_free_for_what_is_held(
    planner: ArmPlanner, tmp_path: Path
) -> None:
    objects = [
        (TISSUES, on_table(resting(TISSUES, np.eye(3), 0.0, 0.0), 0.6, 0.05)),
        wall_at(0.6, 0.2),
    ]
    plan = planned(planner, objects, 0)
    drop = np.array([0.6, 0.38, TABLE_HEIGHT + 0.05])
    X_place = drop_pose(models(), plan.held, drop)
    carry = planner.plan_place(plan.retreat.end, X_place, plan.held)
    independent = judge(tmp_path, [objects[1]], plan.held)
    near = nearest(independent, carry)
    held = {pair: d for pair, d in near.items() if pair[0] == independent.held_name}
    assert min(held.values(), default=1.0) > 0.002
    assert_clear({pair: d for pair, d in near.items() if pair not in held})
    assert_within_limits(carry, planner.config.carry)
    # There, its lowest point is at the height that was asked for, below the cup.
    X_WO = independent.pose("cup", carry.end) @ plan.held.X_GO
    lowest = transform_points(X_WO, np.asarray(models()[TISSUES].mesh.vertices))
    assert lowest[:, 2].min() == pytest.approx(drop[2], abs=1e-4)
    cup = independent.pose("cup", carry.end)[:3, 3]
    np.testing.assert_allclose(cup[:2], drop[:2], atol=1e-4)
    # Without the object, the same motion is found free by less of a detour.
    empty = planner.plan_to(plan.retreat.end, carry.end)
    assert empty.duration < carry.duration


def test_a_straight_line_is_straight_and_turns_nothing(planner: ArmPlanner) -> None:
    q = planner.solve_ik(over_table(0.6, 0.2, 0.3), planner.home)
    shift = np.array([0.02, 0.03, -0.15])
    line = planner.plan_line(q, shift)
    X_start = planner.scene.tool_pose(q)
    for t in np.linspace(0.0, line.duration, 20):
        X = planner.scene.tool_pose(line.value(float(t)))
        np.testing.assert_allclose(X[:3, :3], X_start[:3, :3], atol=2e-3)
        off = np.cross(X[:3, 3] - X_start[:3, 3], shift / np.linalg.norm(shift))
        assert np.linalg.norm(off) < 1e-3
    np.testing.assert_allclose(X[:3, 3], X_start[:3, 3] + shift, atol=1e-5)
    assert_within_limits(line)
    with pytest.raises(PlanFailure, match=r"line: .* too near are"):
        planner.plan_line(q, np.array([0.0, 0.0, -0.4]))


def test_a_plan_leaves_the_scene_as_it_was(planner: ArmPlanner) -> None:
    """What was planned with an object held has no part in what is asked next."""
    objects = pile()
    plan = planned(planner, objects, 2)
    scene, q = planner.scene, plan.approach.end
    before = scene.conflicts(q)
    planner.plan_line(q, np.array([0.0, 0.0, 0.05]), plan.held)
    with pytest.raises(PlanFailure):
        planner.plan_line(q, np.array([0.0, 0.0, -0.4]), plan.held)
    assert scene.held is None
    assert scene.conflicts(q) == before


def test_states_of_the_scene_are_nested(planner: ArmPlanner) -> None:
    objects = pile()
    plan = planned(planner, objects, 2)
    scene, q = planner.scene, plan.approach.end
    with scene.state(start=q):
        assert scene.is_free(q)
        with scene.state(held=plan.held):
            assert scene.held is plan.held
            assert not scene.is_free(q)
        assert scene.held is None
        assert scene.is_free(q)
    assert not scene.is_free(q)


def test_the_arm_leaves_an_object_that_it_still_touches(planner: ArmPlanner) -> None:
    objects = pile()
    plan = planned(planner, objects, 2)
    assert not planner.scene.is_free(plan.approach.end)
    home = planner.plan_to(plan.approach.end, planner.home)
    np.testing.assert_allclose(home.end, planner.home, atol=1e-9)


def test_the_camera_is_brought_to_look_at_a_target(
    planner: ArmPlanner, tmp_path: Path
) -> None:
    objects = pile()
    planner.set_scene(estimate_of(objects, models()))
    target = np.array([0.6, 0.2, TABLE_HEIGHT + 0.03])
    views = list(planner.reachable_viewpoints(target, planner.home))
    names = [view.name for view in views]
    assert names == [n for n in ("front", "left", "right", "top") if n in names]
    assert len(names) >= 3
    independent = judge(tmp_path, objects)
    for view in views:
        motion = planner.plan_look(planner.home, view.X_WC)
        X_WC = independent.pose("optical", motion.end)
        assert np.linalg.norm(X_WC[:3, 3] - view.X_WC[:3, 3]) < 0.031
        sight = target - X_WC[:3, 3]
        off = np.arccos(sight @ X_WC[:3, 2] / np.linalg.norm(sight))
        assert off < 0.09 + 0.03 / 0.35
        assert_clear(nearest(independent, motion))
    front = next(view for view in views if view.name == "front")
    assert front.X_WC[0, 3] < target[0] - 0.1  # on the robot's side


def test_looking_through_the_table_fails(planner: ArmPlanner) -> None:
    below = look_at(np.array([0.6, 0.2, 0.3]), np.array([0.6, 0.2, 0.75]))
    with pytest.raises(PlanFailure, match="reaches the viewpoint") as info:
        planner.plan_look(planner.home, below)
    assert info.value.stage == "look"


def test_the_same_question_has_the_same_answer(planner: ArmPlanner) -> None:
    objects = [*pile(), wall_at(0.6, 0.33)]
    first = planned(planner, objects, 1)
    planner.plan_to(planner.home, first.transfer.end)
    again = planned(planner, objects, 1)
    fresh = planned(ArmPlanner(cell(), models()), objects, 1)
    for other in (again, fresh):
        for name in ("transfer", "approach", "retreat"):
            a, b = getattr(first, name), getattr(other, name)
            np.testing.assert_array_equal(a.q, b.q)
            np.testing.assert_array_equal(a.times, b.times)


def test_two_of_a_kind_are_two_obstacles(planner: ArmPlanner, tmp_path: Path) -> None:
    low = resting(SOAP, turned("y", 90), 0.0, 0.0)
    objects = [
        (SOAP, on_table(low, 0.55, 0.05)),
        (SOAP, on_table(low, 0.65, 0.25)),
        (SOAP, on_table(low, 0.6, 0.15)),
    ]
    inside = [
        planner.solve_ik(make_pose(DOWN, X[:3, 3]), planner.home) for _, X in objects
    ]
    planner.set_scene(estimate_of(objects, models()))
    for q in inside:
        assert not planner.scene.is_free(q)
        assert "dove_beauty_bar" in planner.scene.conflicts(q)
    plan = planned(planner, objects, 1)
    assert plan.candidate.index == 1
    near = nearest(judge(tmp_path, objects), plan.transfer)
    assert_clear(near)


def test_the_torso_may_turn_for_more_reach(planner: ArmPlanner) -> None:
    config = ArmPlannerConfig()
    turning = ArmPlanner(
        cell(),
        models(),
        replace(
            config,
            joints=("torso_joint_b1", *config.joints),
            home=(0.0, *config.home),
            limits={"torso_joint_b1": (-0.6, 0.6)},
        ),
    )
    X_WG = over_table(0.7, -0.25, 0.1)
    with pytest.raises(PlanFailure):
        planner.solve_ik(X_WG, planner.home)
    q = turning.solve_ik(X_WG, turning.home)
    assert q.shape == (8,)
    assert -0.6 <= q[0] < -0.05
    motion = turning.plan_to(turning.home, q)
    assert motion.joints[0] == "torso_joint_b1"


def test_a_planned_joint_is_no_other_joint(planner: ArmPlanner) -> None:
    with pytest.raises(InputError, match="arm_left_joint_1_s is planned"):
        planner.set_other_joints({"arm_left_joint_1_s": 0.1})


def test_the_other_arm_is_an_obstacle_where_it_is(planner: ArmPlanner) -> None:
    # The right arm stretched out over the table, in the way of the left one.
    try:
        X_WG = over_table(0.55, 0.0, 0.2)
        q = planner.solve_ik(X_WG, planner.home)
        planner.set_other_joints(
            {"arm_right_joint_1_s": 0.6, "arm_right_joint_2_l": 1.9}
        )
        assert not planner.scene.is_free(q)
        assert "arm_right" in planner.scene.conflicts(q)
    finally:
        planner.set_other_joints(ArmPlannerConfig().other_joints)


def test_names_that_do_not_exist_are_named() -> None:
    config = replace(ArmPlannerConfig(), tool_frame="suction_gripper::cap")
    with pytest.raises(InputError, match="nothing is called 'suction_gripper::cap'"):
        ArmPlanner(cell(), models(), config)
    with pytest.raises(InputError, match="has 6 angles for 7 joints"):
        replace(ArmPlannerConfig(), home=(0.0,) * 6)
    with pytest.raises(InputError, match="speed: 2 is not a share"):
        replace(ArmPlannerConfig(), speed=2)


def test_a_cell_with_a_loose_body_is_refused() -> None:
    file = f"file://{APC11}/dove_beauty_bar/dove_beauty_bar.sdf"
    loose = ModelDirective(add_model=AddModel(name="loose", file=file))
    with pytest.raises(InputError, match="loose::body is free to move"):
        ArmPlanner([*cell(), loose], models())


def test_the_drop_pose_keeps_a_hanging_object_off_the_ground() -> None:
    X_GO = make_pose(turned("x", 35), [0.01, 0.0, 0.05])
    held = HeldObject(ERASER, X_GO)
    X_WG = drop_pose(models(), held, np.array([0.1, 0.2, 0.3]))
    vertices = transform_points(X_WG @ X_GO, np.asarray(models()[ERASER].mesh.vertices))
    assert vertices[:, 2].min() == pytest.approx(0.3)
    np.testing.assert_allclose(X_WG[:3, 2], [0, 0, -1])
    np.testing.assert_allclose(X_WG[:2, 3], [0.1, 0.2])
    np.testing.assert_allclose(inverse(X_WG) @ X_WG, np.eye(4), atol=1e-12)
