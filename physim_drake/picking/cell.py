# SPDX-License-Identifier: MIT
"""The planner, viewpoints and tote of a scenario's cell, and whether it can work."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from physim_drake.errors import InputError
from physim_drake.objects.model import ObjectLibrary
from physim_drake.picking.arm_planner import ArmPlanner
from physim_drake.picking.initial_scene import check_objects
from physim_drake.picking.planner_config import PlanFailure
from physim_drake.picking.planning_plant import find_frame
from physim_drake.picking.policy import PickConditions
from physim_drake.picking.scenario import PickScenario, RegionConfig
from physim_drake.picking.suction_points import SuctionCup
from physim_drake.picking.tote import Tote
from physim_drake.picking.viewpoints import look_at
from physim_drake.poses import Array, inverse, make_pose, transform_points
from physim_drake.sensors.presets import PRESETS

_DOWN = np.diag([1.0, -1.0, -1.0])
_DROPS = np.array([[-0.5, 0.0], [0.5, 0.0], [0.0, 0.35], [0.0, -0.35], [0.0, 0.0]])
"""Points of the tote, as shares of its half extents, the first ones far apart."""

_REACH_HEIGHT = 0.10  # m above the pick area, where the arm must get to
_CONE = 0.35  # rad; the reach need not be upright


@dataclass(frozen=True)
class PickCellGeometry:
    """Where things are in a scenario's cell.

    Attributes:
        planner: the arm's planner, with the scenario's robot and cell.
        X_WA: pose of the pick area, z up, (4, 4).
        views: poses of the camera X_WC (4, 4), as the scenario lists them.
        tote: tote that objects go into.
        conditions: conditions that all picks have in common.
    """

    planner: ArmPlanner
    X_WA: Array
    views: tuple[Array, ...]
    tote: Tote
    conditions: PickConditions


@dataclass(frozen=True)
class PreparedCell:
    """A scenario whose objects are loaded and whose robot can do its work.

    Attributes:
        scenario: the cell and its task.
        library: the objects.
        geometry: places of the things in the cell.
    """

    scenario: PickScenario
    library: ObjectLibrary
    geometry: PickCellGeometry


def prepare_cell(scenario: PickScenario) -> PreparedCell:
    """Loads the objects of a scenario, reads its cell, and checks both.

    Raises:
        InputError: if the scenario cannot work; see `load_objects`, `check_objects`,
            `cell_geometry` and `check_cell`.
    """
    library = load_objects(scenario)
    check_objects(scenario, library)
    geometry = cell_geometry(scenario, library)
    check_cell(scenario, geometry)
    return PreparedCell(scenario, library, geometry)


def load_objects(scenario: PickScenario) -> ObjectLibrary:
    """The objects of a scenario.

    Raises:
        InputError: if a model is missing, or there are too few.
    """
    library = ObjectLibrary.load(Path(scenario.objects.library))
    if scenario.objects.names:
        chosen = [library.by_name(name) for name in scenario.objects.names]
        library = ObjectLibrary(chosen, library.source)
    most = scenario.objects.count[1]
    if len(library) < most:
        raise InputError(
            "objects",
            f"asks for {most}, and there are {len(library)}",
            "ask for fewer, or name more",
            "count",
        )
    return library


def cell_geometry(scenario: PickScenario, library: ObjectLibrary) -> PickCellGeometry:
    """Reads the cell of a scenario.

    Raises:
        InputError: if a file or frame is missing.
    """
    try:
        planner = ArmPlanner(scenario.directives, library, scenario.planner)
    except (RuntimeError, ValueError) as error:
        raise unusable_directives(error) from error
    X_WA = _frame_pose(planner, scenario.pick_area)
    X_WT = _frame_pose(planner, scenario.tote)
    floor = np.array(scenario.tote.half_extents)
    drops = np.column_stack([_DROPS * floor, np.zeros(len(_DROPS))])
    middle = X_WA[:3, 3]
    views = tuple(
        look_at(middle + v.distance * X_WA[:3, :3] @ v.direction(), middle)
        for v in scenario.look.views
    )
    cup = SuctionCup(
        lip_radius=scenario.gripper.lip_radius,
        holding_force=scenario.gripper.max_force,
    )
    return PickCellGeometry(
        planner,
        X_WA,
        views,
        Tote(
            X_WT,
            floor,
            transform_points(X_WT, drops),
            scenario.task.release_height,
            scenario.task.carry_height,
        ),
        PickConditions(cup=cup, max_tilt=np.radians(scenario.task.max_tilt_deg)),
    )


def unusable_directives(error: Exception) -> InputError:
    """The error that says why directives cannot be used, in a line."""
    text = " ".join(str(error).split())
    return InputError(
        "directives", text[:300], "check the files, models and frames they name"
    )


def check_cell(scenario: PickScenario, cell: PickCellGeometry) -> None:
    """Checks that the robot of a cell can do its work, before anything is simulated.

    Raises:
        InputError: if its home is beyond a joint's limits or touches something, the
            pick area or tote is out of reach, or the camera cannot see the pick area.
    """
    planner = cell.planner
    _check_home(planner)
    for region, X_WR in (
        (scenario.pick_area, cell.X_WA),
        (scenario.tote, cell.tote.X_WT),
    ):
        _check_reach(planner, region, X_WR)
    _check_views(scenario, cell)


def _frame_pose(planner: ArmPlanner, region: RegionConfig) -> Array:
    plant = planner.scene.plant
    frame = find_frame(plant, region.frame)
    X_WR = frame.CalcPoseInWorld(plant.CreateDefaultContext()).GetAsMatrix4()
    if X_WR[2, 2] < 0.999:
        raise InputError(
            region.frame, "is not level", "turn the frame so that its z points up"
        )
    return np.asarray(X_WR)


def _check_home(planner: ArmPlanner) -> None:
    scene, q = planner.scene, planner.home
    for n, name in enumerate(planner.config.joints):
        if not scene.lower[n] <= q[n] <= scene.upper[n]:
            raise InputError(
                "planner",
                f"{name} is at {q[n]:.3f} rad, its limits less the margin are "
                f"{scene.lower[n]:.3f} to {scene.upper[n]:.3f}",
                "choose another posture",
                "home",
            )
    if not scene.is_free(q):
        raise InputError(
            "planner",
            f"too near are {scene.conflicts(q)}",
            "choose another posture, or move the cell's parts",
            "home",
        )


def _check_reach(planner: ArmPlanner, region: RegionConfig, X_WR: Array) -> None:
    p_W = X_WR[:3, 3] + np.array([0.0, 0.0, _REACH_HEIGHT])
    try:
        planner.solve_ik(make_pose(_DOWN, p_W), planner.home, cone=_CONE, radius=0.02)
    except PlanFailure as failure:
        x, y, z = np.round(X_WR[:3, 3], 2)
        raise InputError(
            region.frame,
            f"the arm does not reach it at ({x:g}, {y:g}, {z:g}) m: {failure}",
            "move it nearer to the robot",
        ) from failure


def _check_views(scenario: PickScenario, cell: PickCellGeometry) -> None:
    preset = PRESETS[scenario.look.camera]
    reasons = []
    for n, X_WC in enumerate(cell.views):
        p_C = transform_points(inverse(X_WC), cell.X_WA[None, :3, 3])[0]
        nearest, farthest = preset.noise.min_range, preset.noise.max_range
        if scenario.look.noise and not nearest < p_C[2] < farthest:
            reasons.append(
                f"viewpoint {n + 1} is {p_C[2]:.2f} m away, the camera measures from "
                f"{nearest:g} to {farthest:g} m"
            )
            continue
        try:
            cell.planner.plan_look(cell.planner.home, X_WC)
            return
        except PlanFailure as failure:
            reasons.append(f"viewpoint {n + 1} cannot be taken: {failure}")
    raise InputError(
        "look",
        f"the camera sees nothing of {scenario.pick_area.frame}: {'; '.join(reasons)}",
        "choose viewpoints that the arm can take",
        "views",
    )
