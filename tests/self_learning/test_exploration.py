# SPDX-License-Identifier: MIT
"""The robot looks at a scene, and a detector that forgets stands for a network."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from physim_drake.datasets.bop import BopDataset
from physim_drake.datasets.bop_writer import BopImage
from physim_drake.errors import InputError
from physim_drake.models import APC11
from physim_drake.observation.detector import LabelImage
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.picking.look_postures import LookingConditions
from physim_drake.picking.scenario import ObjectsConfig, PickScenario
from physim_drake.pose_errors import pose_error
from physim_drake.scenes.views import jittered_boxes
from physim_drake.self_learning.exploration import (
    ExplorationConfig,
    Explorer,
    explore_scenes,
    write_judged_scenes,
)
from physim_drake.self_learning.labels import LabelledScene
from physim_drake.storage.typed_yaml import load_typed_yaml
from physim_drake.systems.looking_cell import LookingCell

DIM = Path(__file__).parents[2] / "examples" / "lighting" / "dim.yaml"
VIEWS = 3


class Forgetful:
    """Sees everything in two views of three, nothing in the third."""

    def __init__(self, cell: LookingCell) -> None:
        self._cell, self._looks = cell, 0

    def detect(
        self,
        observation: RgbdObservation,
        labels: LabelImage | None,
        generator: np.random.Generator,
    ) -> tuple[Detection, ...]:
        self._looks += 1
        if self._looks % VIEWS == 0:
            return ()
        assert labels is not None
        ids = [
            i.object_id
            for i in self._cell.instances
            if (labels == i.body_index).sum() > 400
        ]
        masks = self._cell.true_masks(labels, ids)
        return tuple(jittered_boxes(masks, ids, 0.03, generator))


@pytest.fixture(scope="module")
def explorer():
    scenario = PickScenario(
        objects=ObjectsConfig(
            str(APC11),
            ("folgers_classic_roast_coffee", "dove_beauty_bar", "rawlings_baseball"),
            (2, 2),
            (1,),
        )
    )
    look = replace(scenario.look, expansions=15)
    config = ExplorationConfig(views=VIEWS)
    conditions = load_typed_yaml(DIM, LookingConditions)
    with Explorer(replace(scenario, look=look), conditions, config) as result:
        yield result


@pytest.fixture(scope="module")
def dataset(explorer: Explorer, tmp_path_factory: pytest.TempPathFactory):
    out = tmp_path_factory.mktemp("learnt") / "out"
    told: list[LabelledScene] = []
    figures = explore_scenes(
        explorer,
        Forgetful(explorer.cell),
        out,
        1,
        lambda number, scene: told.append(scene),
    )
    return BopDataset(out), figures, told


@pytest.fixture(scope="module")
def judged(explorer: Explorer) -> tuple[BopImage, ...]:
    """The same scene with true labels. Its first view is the same, too."""
    return explorer.judged(0)


def test_labels_are_those_of_the_truth(
    explorer: Explorer, dataset: Any, judged: tuple[BopImage, ...]
):
    data, true = dataset[0], judged[0]
    first = data.images()[0]
    X_WC = data.observation(*first).X_WC
    np.testing.assert_allclose(X_WC, true.observation.X_WC, atol=1e-6)
    poses = dict(zip(true.object_ids, true.X_CO, strict=True))
    masks = dict(zip(true.object_ids, true.visible, strict=True))
    for pose, d in zip(data.ground_truth(*first), data.masks(*first), strict=True):
        symmetry = explorer.library[d.object_id].symmetry
        error = pose_error(poses[d.object_id], pose.X_CO, symmetry)
        assert error.within(np.radians(3), 0.004)
        both, either = d.mask & masks[d.object_id], d.mask | masks[d.object_id]
        assert both.sum() > 0.93 * either.sum()


def test_what_was_missed_is_labelled(dataset: Any):
    data, figures, told = dataset
    certain = len(told[0].objects)
    assert 1 <= certain <= 2
    assert figures["labels"] == sum(len(data.masks(*i)) for i in data.images())
    assert figures["labels"] == VIEWS * certain
    assert figures["images"] == len(data.images())
    assert figures["missed"] == certain  # in the view in which it saw nothing
    assert [s["labels"] for s in figures["scenes"]] == [s.labels for s in told]
    assert json.loads((data.root / "learning.json").read_text()) == figures
    assert (data.root / "models" / "models_info.json").exists()


def test_the_views_differ_and_look_at_the_table(dataset: Any):
    data, _, _ = dataset
    places = [data.observation(*i).X_WC for i in data.images()]
    for n, X in enumerate(places):
        assert X[2, 2] < -0.5  # the camera looks down
        assert all(np.linalg.norm((X - Y)[:3, 3]) > 0.02 for Y in places[:n])


def test_the_light_is_that_of_the_conditions(judged: tuple[BopImage, ...]):
    """One orange lamp: hardly any blue."""
    color = judged[0].observation.color
    assert color is not None
    red, _, blue = color.reshape(-1, 3).mean(axis=0)
    assert blue < 0.4 * red


def test_judged_scenes_are_written(
    explorer: Explorer, judged: tuple[BopImage, ...], tmp_path: Path
):
    looks: Any = SimpleNamespace(library=explorer.library, judged=lambda n: judged)
    write_judged_scenes(looks, tmp_path / "test", 1)
    data = BopDataset(tmp_path / "test")
    assert len(data.images()) == VIEWS
    for image in data.images():
        assert all(d.mask.sum() > 400 for d in data.masks(*image))


def test_a_folder_in_use_is_kept(explorer: Explorer, tmp_path: Path):
    (tmp_path / "kept").touch()
    with pytest.raises(InputError, match="is not empty"):
        explore_scenes(explorer, Forgetful(explorer.cell), tmp_path, 1)
    assert [p.name for p in tmp_path.iterdir()] == ["kept"]


def test_conditions_without_a_light(tmp_path: Path):
    path = tmp_path / "dark.yaml"
    path.write_text("renderer: {lights: []}\n")
    with pytest.raises(InputError, match="give one light or more"):
        load_typed_yaml(path, LookingConditions)
