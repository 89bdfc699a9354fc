# SPDX-License-Identifier: MIT
"""A pick cell and what happens in it, as one typed YAML file.

If Drake has a schema, it is used: model directives, plant, scene graph, with the names
of Drake's own scenarios. Unknown keys are errors. docs/pick-cell.md
goes through a file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

from pydrake.geometry import SceneGraphConfig
from pydrake.multibody.parsing import AddDirectives, ModelDirective
from pydrake.multibody.plant import MultibodyPlantConfig

from physim_drake.errors import InputError
from physim_drake.estimation.method_config import MethodConfig
from physim_drake.models import PACKAGE_XML
from physim_drake.objects.containers import ContainerName
from physim_drake.picking.detector_name import DetectorName as DetectorName
from physim_drake.picking.planner_config import ArmPlannerConfig
from physim_drake.sensors.presets import CameraName
from physim_drake.storage.typed_yaml import load_typed_yaml
from physim_drake.suction.cup import SuctionConfig

_SCENARIO_PACKAGE = "package://scenario/"
_RENAMED = {"hypotheses": "representatives"}
"""Keys of scenario files that go by another name now."""


def _plant() -> MultibodyPlantConfig:
    config = MultibodyPlantConfig()
    config.time_step = 0.005
    config.discrete_contact_approximation = "sap"
    config.contact_model = "hydroelastic_with_fallback"
    config.use_sampled_output_ports = False
    return config


def _scene_graph() -> SceneGraphConfig:
    config = SceneGraphConfig()
    # Overlap is pushed out with this time constant; Drake's 0.1 s creeps.
    config.default_proximity_properties.relaxation_time = 0.02
    return config


def _directives() -> tuple[ModelDirective, ...]:
    cell = "package://physim_drake_models/pick_cell/pick_cell.dmd.yaml"
    return (ModelDirective(add_directives=AddDirectives(file=cell)),)


@dataclass(frozen=True)
class DriveConfig:
    """How the joints follow their reference: stiff, with gravity compensated.

    Every industrial controller compensates gravity of robot and tools. That of what
    the robot holds is not compensated.

    Attributes:
        stiffness: stiffness of each joint, N m/rad.
        damping: damping of each joint, N m s/rad.
    """

    stiffness: float = 20000.0
    damping: float = 1000.0


@dataclass(frozen=True)
class RegionConfig:
    """A level rectangle that a frame of the directives stands in the middle of.

    Attributes:
        frame: name of the frame, whose z points up.
        half_extents: half the lengths along the frame's x and y, m.
    """

    frame: str = "pick_area"
    half_extents: tuple[float, float] = (0.2, 0.2)

    def __post_init__(self) -> None:
        if len(self.half_extents) != 2 or min(self.half_extents) <= 0:
            raise InputError(
                self.frame, "is not a rectangle", "give two lengths above 0, m"
            )


@dataclass(frozen=True)
class ObjectsConfig:
    """What lies on the table at the beginning of an episode.

    Attributes:
        library: folder of the object models: a path, from the scenario's folder if it
            is relative, or the name of a set that comes with the package.
        names: objects to draw from; all if it is empty.
        count: fewest and most objects of an episode.
        levels: interaction levels (1 apart, 2 two that touch, 3 three), episode by
            episode in turn.
        container: what they are settled on or in. It is not part of the cell: a tote
            that they lie in must also stand in the directives.
    """

    library: str = "apc11"
    names: tuple[str, ...] = ()
    count: tuple[int, int] = (3, 3)
    levels: tuple[int, ...] = (1, 2, 3)
    container: ContainerName = ContainerName.TABLE

    def __post_init__(self) -> None:
        if len(self.count) != 2 or not 1 <= self.count[0] <= self.count[1]:
            raise InputError(
                "objects",
                f"is {list(self.count)}",
                "give [fewest, most], 1 or more",
                "count",
            )
        if not self.levels or not all(1 <= level <= 3 for level in self.levels):
            raise InputError(
                "objects", f"is {list(self.levels)}", "give some of 1, 2, 3", "levels"
            )


@dataclass(frozen=True)
class ViewpointConfig:
    """From where the wrist camera looks at the middle of the pick area.

    Attributes:
        azimuth_deg: bearing of the camera from the middle, about z from x, deg.
        elevation_deg: angle of the camera above the surface, deg.
        distance: distance of the camera from the middle, m.
    """

    azimuth_deg: float = 180.0
    elevation_deg: float = 75.0
    distance: float = 0.55

    def __post_init__(self) -> None:
        if not 0 < self.elevation_deg <= 90 or not self.distance > 0:
            raise InputError(
                "viewpoint",
                f"elevation {self.elevation_deg:g} deg, distance {self.distance:g} m",
                "look from above, 0 to 90 deg, from more than 0 m",
            )

    def direction(self) -> tuple[float, float, float]:
        """From the middle to the camera, unit."""
        a, e = math.radians(self.azimuth_deg), math.radians(self.elevation_deg)
        return math.cos(a) * math.cos(e), math.sin(a) * math.cos(e), math.sin(e)


def _views() -> tuple[ViewpointConfig, ...]:
    return (
        ViewpointConfig(180.0, 75.0, 0.60),
        ViewpointConfig(-110.0, 60.0, 0.58),
        ViewpointConfig(110.0, 60.0, 0.58),
        ViewpointConfig(45.0, 60.0, 0.55),
    )


@dataclass(frozen=True)
class LookConfig(MethodConfig):
    """How the cell sees; see `MethodConfig` for the method and its effort.

    Attributes:
        camera: preset of the wrist camera.
        noise: whether its images have a real camera's errors.
        detector: a trained network, or an oracle that knows what each pixel shows.
        weights: file that physim-drake train wrote, from the scenario's folder if it
            is relative; if it is empty, the weights that come with the package, which
            know the objects of apc11.
        least_score: score below which a detection of the network is dropped, 0..1.
        box_jitter: share of a box's size that each of its sides is off by at most, in
            the oracle's detections.
        min_pixels: number of pixels that an object must show to be detected.
        expansions: see `MethodConfig`; fewer here, as a cell looks again.
        latency: simulated time that an estimate takes, s. The simulation does not
            know how long the computation takes. This is what a fast computer needs.
        views: viewpoints in the order they are used.
    """

    camera: CameraName = CameraName.D415
    noise: bool = True
    detector: DetectorName = DetectorName.NETWORK
    weights: str = ""
    least_score: float = 0.5
    box_jitter: float = 0.06
    min_pixels: int = 400
    expansions: int = 60
    latency: float = 2.0
    views: tuple[ViewpointConfig, ...] = field(default_factory=_views)

    _section = "look"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.views:
            raise InputError("look", "is empty", "give one viewpoint or more", "views")
        if not 0.0 <= self.least_score <= 1.0:
            raise InputError(
                "look", f"is {self.least_score}", "give 0 to 1", "least_score"
            )


@dataclass(frozen=True)
class TaskConfig:
    """How hard the cell tries.

    Attributes:
        period: time between decisions of the task, s.
        planning_time: simulated time that planning takes, s.
        max_plans: number of candidates that are planned before another look is taken.
        settle_time: time from the arrival at a viewpoint to the look, s.
        max_views: views of one scene before it is picked from with what is known.
        min_confidence: confidence below which an object is looked at again from
            elsewhere.
        last_confidence: confidence from which on it is picked all the same, if no view
            of the scene gave anything better.
        tries: failed picks of one object before it is given up.
        max_failures: failures in a row of any kind before the episode is given up.
        empty_looks: looks from different viewpoints that must show nothing before the
            table counts as empty.
        estimate_timeout: time after which an estimate has failed, s.
        seal_level: level of the vacuum sensor from which on the cup holds, 0..1.
        seal_timeout: time after which a cup that has not reached the level does not
            seal, s.
        lost_level: level of the vacuum sensor below which the object is gone, 0..1.
        release_time: time that the vacuum gets to vanish over the tote, s.
        release_height: height of an object's lowest point above the tote's floor when
            it is let go, m; more if the tote is full.
        carry_height: the same height when it arrives over the tote, clear of the
            walls, m.
        max_tilt_deg: tilt of the cup's axis from the vertical when it comes down, deg.
    """

    period: float = 0.01
    planning_time: float = 0.5
    max_plans: int = 10
    settle_time: float = 0.3
    max_views: int = 3
    min_confidence: float = 0.5
    last_confidence: float = 0.2
    tries: int = 3
    max_failures: int = 8
    empty_looks: int = 2
    estimate_timeout: float = 30.0
    seal_level: float = 0.45
    seal_timeout: float = 0.5
    lost_level: float = 0.2
    release_time: float = 0.3
    release_height: float = 0.04
    carry_height: float = 0.2
    max_tilt_deg: float = 90.0

    def __post_init__(self) -> None:
        for name in ("max_plans", "max_views", "tries", "max_failures", "empty_looks"):
            if getattr(self, name) < 1:
                raise InputError("task", "is less than 1", "give 1 or more", name)
        if not self.period > 0:
            raise InputError("task", "is not positive", "give seconds", "period")


@dataclass(frozen=True)
class PickScenario:
    """A cell, its objects and its task.

    Attributes:
        random_seed: seed of all random choices, with the episode's number.
        max_duration: greatest duration of an episode, simulated, s.
        plant_config: settings of the simulated plant.
        scene_graph_config: settings of its scene graph.
        directives: robot, tools, table, tote and what else stands still. Files of the
            package `physim_drake_models` can be used, and of `scenario`, which is the
            folder of the scenario's file.
        drive: drives of the robot's joints.
        planner: names and distances for the arm's planner.
        gripper: the suction cup.
        objects: objects to pick.
        pick_area: region where objects lie.
        tote: region where they go.
        look: camera, detector, estimate and viewpoints.
        task: thresholds, times and numbers of tries of the task.
    """

    random_seed: int = 0
    max_duration: float = 300.0
    plant_config: MultibodyPlantConfig = field(default_factory=_plant)
    scene_graph_config: SceneGraphConfig = field(default_factory=_scene_graph)
    directives: tuple[ModelDirective, ...] = field(default_factory=_directives)
    drive: DriveConfig = DriveConfig()
    planner: ArmPlannerConfig = field(default_factory=ArmPlannerConfig)
    gripper: SuctionConfig = field(default_factory=SuctionConfig)
    objects: ObjectsConfig = ObjectsConfig()
    pick_area: RegionConfig = RegionConfig("pick_area", (0.2, 0.2))
    tote: RegionConfig = RegionConfig("tote", (0.2, 0.15))
    look: LookConfig = field(default_factory=LookConfig)
    task: TaskConfig = TaskConfig()

    def __post_init__(self) -> None:
        if not self.max_duration > 0:
            raise InputError(
                "scenario", "is not positive", "give seconds", "max_duration"
            )
        if not self.plant_config.time_step > 0:
            raise InputError(
                "scenario",
                "has a time step of 0; drives and suction need a discrete plant",
                "give seconds, such as 0.005",
                "plant_config",
            )


def load_scenario(path: str | Path) -> PickScenario:
    """Reads a scenario. Paths in it start from its folder.

    Raises:
        InputError: if the file cannot be read, has an unknown key, or a value that
            cannot be.
    """
    path = Path(path)
    scenario = _read(path)
    folder = path.resolve().parent
    for directive in scenario.directives:
        _find_file(directive, folder)
    library = _find_library(scenario.objects.library, folder)
    look = scenario.look
    if look.weights:
        look = replace(look, weights=str(folder / look.weights))
    objects = replace(scenario.objects, library=library)
    return replace(scenario, objects=objects, look=look)


def _read(path: Path) -> PickScenario:
    try:
        return load_typed_yaml(path, PickScenario)
    except InputError as error:
        for old, new in _RENAMED.items():
            if f"'{old}'" in error.problem:
                remedy = f"{old!r} is called {new!r} now"
                raise InputError(path, error.problem, remedy, error.field) from error
        raise


def _find_file(directive: ModelDirective, folder: Path) -> None:
    """Makes a path into the scenario's folder one that any parser knows."""
    for part in (directive.add_model, directive.add_directives):
        if part is not None and part.file.startswith(_SCENARIO_PACKAGE):
            name = part.file.removeprefix(_SCENARIO_PACKAGE)
            if ".." in Path(name).parts or Path(name).is_absolute():
                raise InputError(
                    folder,
                    f"{part.file!r} leaves the scenario's folder",
                    "put the file there, or name it by file:// or another package",
                    "directives",
                )
            path = folder / name
            part.file = f"file://{path}"


def _find_library(library: str, folder: Path) -> str:
    here = folder / library
    if not here.is_dir() and (PACKAGE_XML.parent / library).is_dir():
        return str(PACKAGE_XML.parent / library)
    return str(here)
