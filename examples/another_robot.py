# SPDX-License-Identifier: MIT
"""Puts another robot into the pick cell: a six-axis arm on a pedestal.

python examples/another_robot.py [--out FOLDER]

What a cell needs to know of a robot is a model with actuated joints, model directives
that weld the tools to it, and the names in `ArmPlannerConfig`. This script writes such
a model, with the dimensions of a Yaskawa GP7 (`gp7_macro.xacro` of the repository
ros-industrial/motoman) and boxes for links, and lets the arm clear a table.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

from physim_drake.episodes.result import EpisodeResult
from physim_drake.episodes.runner import EpisodeRunner
from physim_drake.picking.scenario import DetectorName, PickScenario, load_scenario

HALF = 1.5707963


@dataclass(frozen=True)
class Link:
    """A link, and the joint that it turns on.

    Attributes:
        name: name of both.
        xyz: position of the joint in the link before, m.
        axis: axis of the joint.
        limits: limits of its angle, rad.
        speed: limit, rad/s.
        effort: limit, N m.
        mass: kg.
        size: size of the box that stands for the link, m.
        center: center of that box, m.
    """

    name: str
    xyz: str
    axis: str
    limits: tuple[float, float]
    speed: float
    effort: float
    mass: float
    size: tuple[float, float, float]
    center: tuple[float, float, float]


LINKS = (
    Link("s", "0 0 0.33", "0 0 1", (-2.967, 2.967), 6.54, 212.7, 4.1,
         (0.19, 0.16, 0.19), (0.0, 0.0, -0.04)),
    Link("l", "0.04 0 0", "0 1 0", (-1.134, 2.530), 5.49, 205.8, 15.9,
         (0.13, 0.13, 0.54), (-0.01, 0.0, 0.21)),
    Link("u", "0 0 0.445", "0 -1 0", (-1.221, 3.316), 7.15, 106.8, 3.1,
         (0.16, 0.13, 0.14), (-0.018, 0.0, 0.024)),
    Link("r", "0.44 0 0.04", "-1 0 0", (-3.316, 3.316), 9.59, 55.9, 3.7,
         (0.38, 0.10, 0.10), (-0.175, 0.0, 0.0)),
    Link("b", "0 0 0", "0 -1 0", (-2.356, 2.356), 9.59, 32.7, 0.5,
         (0.08, 0.06, 0.07), (0.03, 0.0, 0.0)),
    Link("t", "0 0 0", "-1 0 0", (-6.294, 6.294), 17.4, 22.5, 0.1,
         (0.01, 0.06, 0.06), (0.073, 0.0, 0.0)),
)  # fmt: skip

SCENARIO = """
directives:
- add_directives: {file: "package://scenario/cell.dmd.yaml"}
planner:
  robot_models: [arm, suction_gripper, wrist_bracket, realsense_d415]
  joints: [joint_s, joint_l, joint_u, joint_r, joint_b, joint_t]
  home: [0.0, 0.0, -0.2, 0.0, -1.37, 0.0]
  other_joints: {}
objects:
  names: [kleenex_tissue_box, expo_dry_erase_board_eraser]
  count: [2, 2]
  levels: [1]
"""

CELL = """
directives:
- add_frame:
    name: pedestal_top
    X_PF: {base_frame: world, translation: [0, 0, 0.75]}
- add_model: {name: arm, file: "FOLDER/arm.urdf"}
- add_weld: {parent: pedestal_top, child: "arm::base"}
- add_model:
    name: suction_gripper
    file: package://physim_drake_models/suction_gripper/suction_gripper.sdf
- add_weld: {parent: "arm::tool0", child: "suction_gripper::suction_gripper"}
- add_model:
    name: wrist_bracket
    file: package://physim_drake_models/realsense_d415/wrist_bracket.sdf
- add_weld: {parent: "arm::tool0", child: "wrist_bracket::wrist_bracket"}
- add_frame:
    name: wrist_camera
    X_PF:
      base_frame: arm::tool0
      translation: [0.1, 0.0, 0.08]
      rotation: !Rpy { deg: [-12.83958841, 0.0, 90.0] }
- add_model:
    name: realsense_d415
    file: package://physim_drake_models/realsense_d415/realsense_d415.sdf
- add_weld: {parent: wrist_camera, child: "realsense_d415::optical"}
- add_collision_filter_group:
    name: wrist_and_tools
    members:
    - arm::link_b
    - arm::link_t
    - suction_gripper::suction_gripper
    - suction_gripper::suction_cup
    - wrist_bracket::wrist_bracket
    - realsense_d415::realsense
    ignored_collision_filter_groups: [wrist_and_tools]
# The boxes are wider than the links where the elbow folds.
- add_collision_filter_group:
    name: elbow
    members: ["arm::link_l", "arm::link_u", "arm::link_r"]
    ignored_collision_filter_groups: [elbow]
- add_frame:
    name: table_top
    X_PF: {base_frame: world, translation: [0.62, 0.2, 0.75]}
- add_model:
    name: table
    file: package://physim_drake_models/pick_cell/pick_table.sdf
- add_weld: {parent: table_top, child: "table::body"}
- add_frame:
    name: tote
    X_PF: {base_frame: table_top, translation: [-0.12, 0.32, 0.008]}
- add_model:
    name: tote
    file: package://physim_drake_models/pick_cell/pick_tote.sdf
- add_weld: {parent: tote, child: "tote::body"}
- add_frame:
    name: pick_area
    X_PF: {base_frame: table_top, translation: [-0.1, -0.2, 0]}
"""


def write_robot(path: Path) -> None:
    """Writes the arm's URDF."""
    base = _link("base", 6.7, (0.2, 0.2, 0.2), (0.0, 0.0, 0.1))
    parts, parent = [base], "base"
    for link in LINKS:
        parts.append(_link(f"link_{link.name}", link.mass, link.size, link.center))
        parts.append(_joint(link, parent))
        parent = f"link_{link.name}"
    parts.append(
        '<link name="tool0"/><joint name="flange" type="fixed">'
        f'<origin xyz="0.08 0 0" rpy="3.1415927 {-HALF} 0"/>'
        f'<parent link="{parent}"/><child link="tool0"/></joint>'
    )
    text = "\n".join(parts)
    path.write_text(f'<robot name="arm">\n{text}\n</robot>\n', encoding="utf-8")


def _link(
    name: str,
    mass: float,
    size: tuple[float, float, float],
    center: tuple[float, float, float],
) -> str:
    x, y, z = size
    shape = f'<origin xyz="{_text(center)}"/><geometry><box size="{_text(size)}"/>'
    inertia = [mass / 12 * s for s in (y * y + z * z, x * x + z * z, x * x + y * y)]
    return (
        f'<link name="{name}"><inertial><origin xyz="{_text(center)}"/>'
        f'<mass value="{mass}"/><inertia ixx="{inertia[0]}" iyy="{inertia[1]}" '
        f'izz="{inertia[2]}" ixy="0" ixz="0" iyz="0"/></inertial>'
        f"<visual>{shape}</geometry></visual>"
        f"<collision>{shape}</geometry></collision></link>"
    )


def _joint(link: Link, parent: str) -> str:
    name = f"joint_{link.name}"
    low, high = link.limits
    return (
        f'<joint name="{name}" type="revolute"><origin xyz="{link.xyz}"/>'
        f'<parent link="{parent}"/><child link="link_{link.name}"/>'
        f'<axis xyz="{link.axis}"/><limit lower="{low}" upper="{high}" '
        f'velocity="{link.speed}" effort="{link.effort}"/></joint>'
        f'<transmission name="{name}_drive"><type>SimpleTransmission</type>'
        f'<joint name="{name}"/><actuator name="{name}"/></transmission>'
    )


def _text(values: tuple[float, ...]) -> str:
    return " ".join(str(value) for value in values)


def make_scenario(folder: Path) -> PickScenario:
    """Writes robot, cell and scenario into a folder and reads the scenario."""
    folder.mkdir(parents=True, exist_ok=True)
    write_robot(folder / "arm.urdf")
    cell = CELL.replace("FOLDER", f"file://{folder.resolve()}")
    (folder / "cell.dmd.yaml").write_text(cell, encoding="utf-8")
    (folder / "scenario.yaml").write_text(SCENARIO, encoding="utf-8")
    return load_scenario(folder / "scenario.yaml")


def main(
    out: Path, noise: bool = True, detector: DetectorName = DetectorName.NETWORK
) -> EpisodeResult:
    """Runs an episode and prints what happened."""
    scenario = make_scenario(out)
    look = replace(scenario.look, noise=noise, detector=detector)
    scenario = replace(scenario, look=look)
    with EpisodeRunner(scenario) as runner:
        result = runner.run(0)
    for event in result.events:
        print(f"{event.time:6.2f} s  {event.kind}: {event.text}")
    print(f"{result.cleared} of {len(result.objects)} objects cleared")
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/another_robot"))
    main(parser.parse_args().out)
