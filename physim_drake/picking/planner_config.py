# SPDX-License-Identifier: MIT
"""What the arm's planner knows about the robot, and how careful it is.

The defaults are those of the left arm of `models/motoman_sda10f`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from physim_drake.errors import InputError
from physim_drake.poses import Array

_LEFT_ARM = ("1_s", "2_l", "3_e", "4_u", "5_r", "6_b", "7_t")
_QUARTER = 1.570796


def _hanging_arm() -> Mapping[str, float]:
    return {"arm_right_joint_1_s": _QUARTER, "arm_right_joint_2_l": _QUARTER}


@dataclass(frozen=True)
class ArmPlannerConfig:
    """Names in the cell's directives, distances, speeds and effort.

    Attributes:
        robot_models: the model instances that make up the robot and its tools.
        joints: the joints that are planned, in the order of every `q`; add
            `torso_joint_b1` in front to let the torso turn.
        home: a posture above the table from which most of it is reached, rad, one for
            each joint.
        other_joints: angles of the robot's other joints, rad; 0 if not named.
        limits: narrower limits (lower, upper) by joint, rad.
        tool_frame: `model::frame` of the cup's lip, z outward.
        camera_frame: `model::frame` of the camera, z forward.
        cup_body: `model::body` that touches objects.
        tool_bodies: `model::body` of the slender parts behind it.
        padding: distance that the robot keeps from everything, m.
        self_padding: distance that its parts keep from each other, m.
        tool_padding: distance that cup, slender parts and a held object keep from
            objects and the cell, m.
        limit_margin: distance kept from each joint's limits, rad.
        resolution: no point of the robot moves much farther than this between two
            checks of a path, m.
        pre_grasp: the straight approach begins this far off the surface, m.
        press: the cup is pressed this much beyond the contact of its whole lip, m.
        lift: height of the straight retreat, m.
        line_step: distance between two configurations of a straight line, m.
        speed: share of the joints' speed limits that is used, 0..1.
        acceleration: share of their acceleration limits that is used, 0..1.
        default_acceleration: limit of joints that have none, rad/s^2.
        line_speed: speed of the cup on straight lines, m/s.
        carry: share of `speed` and `acceleration` that is used with an object held.
        seed: seed of all random choices; each plan starts from it anew.
        ik_seeds: greatest number of start guesses of an inverse kinematics problem.
        line_attempts: number of configurations that a straight line is tried from.
        rrt_iterations: iterations of the search for a way around obstacles.
    """

    robot_models: tuple[str, ...] = (
        "motoman_sda10f",
        "suction_gripper",
        "wrist_bracket",
        "realsense_d415",
    )
    joints: tuple[str, ...] = tuple(f"arm_left_joint_{name}" for name in _LEFT_ARM)
    home: tuple[float, ...] = (-1.01, 1.44, 1.07, -1.38, -0.37, -1.32, 0.0)
    other_joints: Mapping[str, float] = field(default_factory=_hanging_arm)
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    tool_frame: str = "suction_gripper::cup"
    camera_frame: str = "realsense_d415::optical"
    cup_body: str = "suction_gripper::suction_cup"
    tool_bodies: tuple[str, ...] = ("suction_gripper::suction_gripper",)
    padding: float = 0.01
    self_padding: float = 0.01
    tool_padding: float = 0.003
    limit_margin: float = 0.02
    resolution: float = 0.01
    pre_grasp: float = 0.10
    press: float = 0.002
    lift: float = 0.12
    line_step: float = 0.01
    speed: float = 0.5
    acceleration: float = 0.5
    default_acceleration: float = 5.0
    line_speed: float = 0.10
    carry: float = 0.6
    seed: int = 0
    ik_seeds: int = 36
    line_attempts: int = 8
    rrt_iterations: int = 800

    def __post_init__(self) -> None:
        if len(self.home) != len(self.joints):
            raise InputError(
                "ArmPlannerConfig",
                f"has {len(self.home)} angles for {len(self.joints)} joints",
                "give one angle for each of `joints`",
                "home",
            )
        for name in ("speed", "acceleration", "carry"):
            if not 0 < getattr(self, name) <= 1:
                raise InputError(
                    "ArmPlannerConfig",
                    f"{getattr(self, name)} is not a share",
                    "give one in 0..1, above 0",
                    name,
                )


@dataclass(frozen=True)
class HeldObject:
    """An object at the cup.

    Attributes:
        object_id: id of the object's model.
        X_GO: pose in the cup's frame, (4, 4).
        index: which of the scene's objects it is, which then is not an obstacle; None
            if the scene does not hold it.
    """

    object_id: int
    X_GO: Array
    index: int | None = None


class PlanFailure(Exception):  # noqa: N818 (an outcome to act on, not an error)
    """No plan was found.

    Attributes:
        stage: stage of the plan: `ik`, `approach`, `transfer`, `retreat`, `carry`,
            `look`.
        reason: why, in a sentence.
    """

    def __init__(self, stage: str, reason: str) -> None:
        self.stage, self.reason = stage, reason
        super().__init__(f"{stage}: {reason}")

    def __reduce__(self) -> tuple[type, tuple[str, str]]:
        """Pickles by the constructor's arguments."""
        return type(self), (self.stage, self.reason)
