# SPDX-License-Identifier: MIT
from __future__ import annotations

import urllib.parse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from playwright.sync_api import Page
from pydrake.geometry import Meshcat

from physim_drake.episodes.runner import EpisodeRunner, local_meshcat
from physim_drake.picking.scenario import DetectorName, load_scenario
from physim_drake.systems.pick_cell import PickCellParts
from tests.browser import needs_chromium, opened, screenshot, visible_paths

pytestmark = needs_chromium

SCENARIO = Path("examples/scenarios/single.yaml")
ERASER = "expo_dry_erase_board_eraser"
ESTIMATE = "/perception/look 1/estimate"


@pytest.fixture(scope="module")
def meshcat() -> Meshcat:
    """After the first estimate of an episode, before the pick."""
    meshcat = local_meshcat()
    scenario = load_scenario(SCENARIO)
    look = replace(scenario.look, detector=DetectorName.ORACLE)
    scenario = replace(scenario, look=look, max_duration=4.5)
    with EpisodeRunner(scenario, PickCellParts(meshcat=meshcat)) as runner:
        result = runner.run(0)
    assert len(result.looks) == 1
    return meshcat


def check(page: Page, picture: Path, seen: Callable[[set[str]], bool]) -> None:
    """Waits for the models, then keeps a picture of them."""
    paths: set[str] = set()
    for _ in range(100):
        paths = visible_paths(page)
        if seen(paths):
            break
        page.wait_for_timeout(100)
    assert seen(paths), sorted(paths)
    page.wait_for_timeout(1000)
    assert screenshot(page, picture) > 1000


def robot_and_estimate(paths: set[str]) -> bool:
    robot = "/drake/visualizer/motoman_sda10f/arm_left_link_7_t" in paths
    estimate = any(p.startswith(f"{ESTIMATE}/0 {ERASER}") for p in paths)
    return robot and estimate


def test_the_page_shows_robot_and_estimate(meshcat: Meshcat, pictures: Path) -> None:
    with opened(meshcat.web_url()) as page:
        check(page, pictures / "meshcat-live.png", robot_and_estimate)


def test_the_replay_opens_from_a_file(meshcat: Meshcat, pictures: Path) -> None:
    file = pictures / "replay.html"
    file.write_text(meshcat.StaticHtml())
    with opened(file.as_uri()) as page:
        check(page, pictures / "meshcat-replay.png", robot_and_estimate)


def test_only_this_computer_reaches_it(meshcat: Meshcat) -> None:
    assert urllib.parse.urlparse(meshcat.web_url()).hostname == "localhost"
