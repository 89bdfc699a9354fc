# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physim_drake.errors import InputError
from physim_drake.objects.containers import ContainerName
from physim_drake.picking.initial_scene import check_objects, draw_start, scene_config
from physim_drake.picking.scenario import ObjectsConfig, PickScenario, RegionConfig
from physim_drake.poses import make_pose, transform_points
from physim_drake.scenes.generation import write_models
from tests.synthetic import library

X_WA = make_pose(p=[0.6, 0.1, 0.75])
SCENARIO = PickScenario(
    objects=ObjectsConfig(count=(2, 2), levels=(1, 2)),
    pick_area=RegionConfig("pick_area", (0.2, 0.25)),
)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    return write_models(library(), tmp_path_factory.mktemp("models"))


@pytest.mark.parametrize("episode", [0, 1])
def test_objects_stand_on_the_pick_area_and_within_it(
    files: dict[int, Path], episode: int
) -> None:
    placed = draw_start(SCENARIO, library(), files, X_WA, episode)
    assert len(placed) == 2
    assert max(model.level for model in placed) == episode + 1
    points = np.concatenate(
        [transform_points(m.X_WO, library()[m.object_id].mesh.vertices) for m in placed]
    )
    assert points[:, 2].min() == pytest.approx(0.75, abs=2e-3)
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    assert (low + high) / 2 == pytest.approx([0.6, 0.1], abs=1e-6)
    assert ((high - low) / 2 <= [0.2, 0.25]).all()


def test_the_seed_and_the_episode_decide(files: dict[int, Path]) -> None:
    one = draw_start(SCENARIO, library(), files, X_WA, 0)
    same = draw_start(SCENARIO, library(), files, X_WA, 0)
    other = draw_start(replace(SCENARIO, random_seed=1), library(), files, X_WA, 0)
    assert [m.X_WO.tolist() for m in one] == [m.X_WO.tolist() for m in same]
    assert [m.X_WO.tolist() for m in one] != [m.X_WO.tolist() for m in other]


def test_levels_take_turns() -> None:
    levels = [scene_config(SCENARIO, n).level for n in range(4)]
    assert levels == [1, 2, 1, 2]


def test_what_fits_in_no_area_is_an_error(files: dict[int, Path]) -> None:
    tight = replace(SCENARIO, pick_area=RegionConfig("spot", (0.02, 0.02)))
    with pytest.raises(InputError, match=r"spot: half_extents: 0.04 x 0.04 m"):
        draw_start(tight, library(), files, X_WA, 0)


def test_a_level_that_needs_more_objects_is_an_error() -> None:
    lonely = ObjectsConfig(count=(1, 1), levels=(1, 3))
    with pytest.raises(InputError, match="3 needs 3 objects"):
        check_objects(replace(SCENARIO, objects=lonely), library())


def test_a_tote_is_not_moved_with_its_objects(files: dict[int, Path]) -> None:
    in_tote = replace(SCENARIO.objects, container=ContainerName.TOTE, levels=(1,))
    scenario = replace(
        SCENARIO, objects=in_tote, pick_area=RegionConfig("a", (0.28, 0.21))
    )
    for model in draw_start(scenario, library(), files, X_WA, 0):
        points = transform_points(
            np.linalg.inv(X_WA) @ model.X_WO, library()[model.object_id].mesh.vertices
        )
        assert (np.abs(points[:, :2]) <= [0.281, 0.211]).all()
