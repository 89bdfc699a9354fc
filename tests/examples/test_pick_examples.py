# SPDX-License-Identifier: MIT
from __future__ import annotations

import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physim_drake.models import APC11
from physim_drake.picking.cell import cell_geometry, check_cell, load_objects
from physim_drake.picking.initial_scene import check_objects
from physim_drake.picking.scenario import (
    DetectorName,
    ObjectsConfig,
    PickScenario,
    load_scenario,
)
from physim_drake.picking.task_state import EventKind
from tests.examples.test_examples import FOLDER, load
from tests.picking.scenes import estimate_of
from tests.synthetic import SOAP, TISSUES, library, resting


@pytest.mark.parametrize(
    "path", sorted((FOLDER / "scenarios").glob("*.yaml")), ids=lambda path: path.stem
)
def test_the_cell_of_every_scenario_can_work(path: Path) -> None:
    scenario = load_scenario(path)
    objects = load_objects(scenario)
    check_objects(scenario, objects)
    check_cell(scenario, cell_geometry(scenario, objects))


def test_the_tallest_object_comes_first() -> None:
    policy = load("pick_policy").TallestFirst()
    scene = (
        (SOAP, resting(SOAP, np.eye(3), 0.3, 0.0)),
        (TISSUES, resting(TISSUES, np.eye(3), 0.0, 0.0)),
    )
    order = policy.order(estimate_of(scene), library())
    ids = [candidate.object_id for candidate in order]
    assert set(ids) == {SOAP, TISSUES}
    assert ids == sorted(ids, key=lambda i: i != TISSUES)


@pytest.mark.timeout(300)
def test_another_robot_clears_its_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(FOLDER))  # dataclasses look for their module
    main = importlib.import_module("another_robot").main
    result = main(tmp_path, noise=False, detector=DetectorName.ORACLE)
    assert result.cleared == len(result.objects) == 2
    assert result.count(EventKind.PLACED) == 2


def test_a_scenario_without_a_file_is_the_one_of_the_package() -> None:
    soap = ObjectsConfig(str(APC11), ("dove_beauty_bar",), (1, 1), (1,))
    scenario = replace(PickScenario(), objects=soap)
    check_cell(scenario, cell_geometry(scenario, load_objects(scenario)))
