# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydrake.multibody.parsing import LoadModelDirectivesFromString

from physim_drake.errors import InputError
from physim_drake.models import APC11
from physim_drake.picking.cell import (
    PickCellGeometry,
    cell_geometry,
    check_cell,
    load_objects,
)
from physim_drake.picking.scenario import (
    ObjectsConfig,
    PickScenario,
    RegionConfig,
    ViewpointConfig,
)
from physim_drake.sensors.presets import CameraName

SOAP = ObjectsConfig(str(APC11), ("dove_beauty_bar",), (1, 1), (1,))
SCENARIO = PickScenario(objects=SOAP)
ABOVE = """
- add_frame:
    name: {name}
    X_PF: {{base_frame: world, translation: {place}, rotation: !Rpy {{deg: {turn}}}}}
"""


def with_frame(name: str, place: list[float], turn: Any = (0, 0, 0)) -> PickScenario:
    text = "directives:" + ABOVE.format(name=name, place=place, turn=list(turn))
    more = LoadModelDirectivesFromString(text).directives
    return replace(SCENARIO, directives=(*SCENARIO.directives, *more))


def geometry(scenario: PickScenario) -> PickCellGeometry:
    return cell_geometry(scenario, load_objects(scenario))


def check(scenario: PickScenario) -> None:
    check_cell(scenario, geometry(scenario))


def test_the_cell_that_comes_with_the_package_works() -> None:
    cell = geometry(SCENARIO)
    check_cell(SCENARIO, cell)
    assert cell.X_WA[:3, 3] == pytest.approx([0.58, 0.12, 0.75])
    assert cell.tote.holds(cell.tote.drops[0])
    assert not cell.tote.holds(cell.X_WA[:3, 3])


def test_every_viewpoint_looks_at_the_pick_area() -> None:
    cell = geometry(SCENARIO)
    for view, X_WC in zip(SCENARIO.look.views, cell.views, strict=True):
        to_area = cell.X_WA[:3, 3] - X_WC[:3, 3]
        assert np.linalg.norm(to_area) == pytest.approx(view.distance)
        assert X_WC[:3, 2] @ to_area == pytest.approx(view.distance)
        cell.planner.plan_look(cell.planner.home, X_WC)  # all can be taken


def test_cup_and_candidates_speak_of_the_same_gripper() -> None:
    scenario = replace(SCENARIO, gripper=replace(SCENARIO.gripper, lip_radius=0.01))
    cup = geometry(scenario).conditions.cup
    assert cup.lip_radius == 0.01
    assert cup.holding_force == pytest.approx(scenario.gripper.max_force)


def test_a_pick_area_out_of_reach_is_refused() -> None:
    scenario = replace(
        with_frame("far", [2.5, 0.0, 0.75]), pick_area=RegionConfig("far", (0.2, 0.2))
    )
    with pytest.raises(InputError, match=r"far: the arm does not reach it at \(2.5, 0"):
        check(scenario)


def test_a_tote_out_of_reach_is_refused() -> None:
    scenario = replace(
        with_frame("far", [0.0, 3.0, 0.75]), tote=RegionConfig("far", (0.2, 0.2))
    )
    with pytest.raises(InputError, match="far: the arm does not reach it"):
        check(scenario)


def test_a_frame_that_leans_is_no_region() -> None:
    scenario = replace(
        with_frame("steep", [0.6, 0.1, 0.75], (30, 0, 0)),
        pick_area=RegionConfig("steep", (0.2, 0.2)),
    )
    with pytest.raises(InputError, match="steep: is not level"):
        geometry(scenario)


def test_a_frame_that_is_missing_is_named() -> None:
    with pytest.raises(InputError, match="nothing is called 'nowhere'"):
        geometry(replace(SCENARIO, tote=RegionConfig("nowhere", (0.2, 0.2))))


def test_a_model_that_is_missing_is_named() -> None:
    text = """
directives:
- add_model: {name: a, file: "package://physim_drake_models/no_such_model.sdf"}
"""
    more = LoadModelDirectivesFromString(text).directives
    with pytest.raises(InputError, match=r"no_such_model\.sdf") as caught:
        geometry(replace(SCENARIO, directives=tuple(more)))
    assert "\n" not in str(caught.value)


def test_objects_that_are_missing_are_named() -> None:
    for objects, message in (
        (replace(SOAP, names=("no_such_thing",)), "no_such_thing"),
        (replace(SOAP, count=(1, 2)), "asks for 2, and there are 1"),
        (replace(SOAP, library="/no/such/folder"), "is no folder"),
    ):
        with pytest.raises(InputError, match=message):
            load_objects(replace(SCENARIO, objects=objects))


def test_a_home_beyond_a_joints_limits_is_refused() -> None:
    home = list(SCENARIO.planner.home)
    home[1] = 2.5
    planner = replace(SCENARIO.planner, home=tuple(home))
    with pytest.raises(InputError, match=r"home: arm_left_joint_2_l is at 2\.500 rad"):
        check(replace(SCENARIO, planner=planner))


def test_a_home_in_the_table_is_refused() -> None:
    arm_down = (0.2, 1.6, 1.0, -0.5, 0.0, -0.5, 0.0)
    planner = replace(SCENARIO.planner, home=arm_down)
    with pytest.raises(InputError, match="home: too near are"):
        check(replace(SCENARIO, planner=planner))


@pytest.mark.parametrize(
    ("view", "message"),
    [
        (ViewpointConfig(distance=0.2), "0.20 m away, the camera measures from 0.29"),
        (ViewpointConfig(distance=2.0), "cannot be taken"),
    ],
)
def test_a_camera_that_sees_nothing_is_refused(
    view: ViewpointConfig, message: str
) -> None:
    look = replace(SCENARIO.look, camera=CameraName.D415, views=(view,))
    with pytest.raises(InputError, match="sees nothing of pick_area") as caught:
        check(replace(SCENARIO, look=look))
    assert message in str(caught.value)


def test_one_viewpoint_that_works_is_enough() -> None:
    views = (ViewpointConfig(distance=2.0), ViewpointConfig())
    check(replace(SCENARIO, look=replace(SCENARIO.look, views=views)))
