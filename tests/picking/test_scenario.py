# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path

import pytest

from physim_drake.errors import InputError
from physim_drake.models import APC11
from physim_drake.objects.containers import ContainerName
from physim_drake.picking.scenario import (
    PickScenario,
    ViewpointConfig,
    load_scenario,
)

EXAMPLES = Path(__file__).parents[2] / "examples" / "scenarios"


def load(folder: Path, text: str) -> PickScenario:
    path = folder / "cell.yaml"
    path.write_text(text, encoding="utf-8")
    return load_scenario(path)


def test_a_file_needs_to_say_only_what_differs(tmp_path: Path) -> None:
    scenario = load(tmp_path, "random_seed: 7\nplanner: {speed: 0.25}\n")
    assert scenario.random_seed == 7
    assert scenario.planner.speed == 0.25
    assert scenario.planner.home == PickScenario().planner.home
    assert scenario.plant_config.time_step == 0.005
    assert load(tmp_path, "").task == PickScenario().task


def test_drakes_schemas_are_those_of_drake(tmp_path: Path) -> None:
    scenario = load(
        tmp_path,
        """
plant_config: {time_step: 0.002, discrete_contact_approximation: lagged}
scene_graph_config: {default_proximity_properties: {relaxation_time: 0.05}}
directives:
- add_frame:
    name: here
    X_PF: {base_frame: world, translation: [1, 2, 3], rotation: !Rpy {deg: [0, 0, 9]}}
objects: {container: tote, count: [2, 4]}
look: {camera: d435, views: [{elevation_deg: 60}, {azimuth_deg: 10}]}
""",
    )
    assert scenario.plant_config.discrete_contact_approximation == "lagged"
    proximity = scenario.scene_graph_config.default_proximity_properties
    assert proximity.relaxation_time == 0.05
    (directive,) = scenario.directives
    assert directive.add_frame.name == "here"
    assert scenario.objects.container is ContainerName.TOTE
    assert scenario.objects.count == (2, 4)
    assert scenario.look.views[0].elevation_deg == 60
    assert scenario.look.views[1].elevation_deg == ViewpointConfig().elevation_deg


def test_paths_start_from_the_file(tmp_path: Path) -> None:
    (tmp_path / "things").mkdir()
    scenario = load(
        tmp_path,
        """
directives:
- add_directives: {file: "package://scenario/cell.dmd.yaml"}
objects: {library: things}
""",
    )
    (directive,) = scenario.directives
    assert directive.add_directives.file == f"file://{tmp_path}/cell.dmd.yaml"
    assert scenario.objects.library == str(tmp_path / "things")
    assert Path(load(tmp_path, "").objects.library) == APC11


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("colour: red", "colour"),
        ("task: {tried: 3}", "tried"),
        ("directives: [{add_modle: {}}]", "add_modle"),
        ("look: {camera: d999}", "'d999' is not one of d415"),
        ("look: {views: []}", "look: views: is empty"),
        ("look: {expansions: 0}", "look: expansions: is 0; give a positive number"),
        ("look: {hypotheses: 9}", "'hypotheses' is called 'representatives' now"),
        ("look: {views: [{elevation_deg: 100}]}", "elevation 100 deg"),
        ("task: {tries: 0}", "task: tries: is less than 1"),
        ("task: {period: 0}", "task: period: is not positive"),
        ("objects: {count: [3, 1]}", "objects: count: is [3, 1]"),
        ("objects: {levels: [4]}", "objects: levels: is [4]"),
        ("plant_config: {time_step: 0.0}", "a time step of 0"),
        ("max_duration: 0", "max_duration: is not positive"),
        ("pick_area: {half_extents: [0.1]}", "not a rectangle"),
        ("planner: {speed: 2.0}", "speed: 2.0 is not a share"),
        ("gripper: {stroke: -1}", "stroke: is -1"),
        ("random_seed: many", "'many'"),
        ("a: [", "cell.yaml"),
    ],
)
def test_a_file_that_cannot_be_used_says_what_is_wrong(
    tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(InputError) as caught:
        load(tmp_path, text)
    assert str(caught.value).startswith(str(tmp_path / "cell.yaml"))
    assert message in str(caught.value)


def test_a_file_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        load_scenario(tmp_path / "nothing.yaml")


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.yaml")), ids=lambda p: p.stem)
def test_every_example_can_be_read(path: Path) -> None:
    assert load_scenario(str(path)).directives
