# SPDX-License-Identifier: MIT
from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from physim_drake.errors import InputError, PhysimError
from physim_drake.objects.containers import ContainerName, load_container
from physim_drake.objects.model import ObjectLibrary, ObjectModel
from physim_drake.poses import inverse, is_rotation, transform_points
from physim_drake.registration.registration_model import registration_model
from physim_drake.scenes.config import RestLimits, SceneConfig
from physim_drake.scenes.contact_graph import interaction_levels, largest_group
from physim_drake.scenes.generation import (
    GeneratedScene,
    check_scene_config,
    generate_scene,
    write_models,
)
from physim_drake.scenes.plant import CONTAINER, NotAtRestError, ScenePlant
from physim_drake.scenes.views import ViewConfig, draw_camera


@pytest.fixture(scope="module")
def scenes(library: ObjectLibrary) -> dict[int, GeneratedScene]:
    return {
        level: generate_scene(library, SceneConfig(level, 3, 3), seed=level)
        for level in (1, 2, 3)
    }


@pytest.fixture(scope="module")
def files(
    library: ObjectLibrary, tmp_path_factory: pytest.TempPathFactory
) -> dict[int, Path]:
    return write_models(library, tmp_path_factory.mktemp("models"))


def test_scene_has_the_level_asked_for(scenes: dict[int, GeneratedScene]):
    for level, scene in scenes.items():
        assert max(scene.levels) == level
        assert scene.levels == interaction_levels(3, scene.edges)


def test_poses_are_rigid(scenes: dict[int, GeneratedScene]):
    for scene in scenes.values():
        assert all(is_rotation(X[:3, :3], 1e-9) for X in scene.X_WO)


def test_touching_objects_touch_by_their_meshes(
    scenes: dict[int, GeneratedScene], library: ObjectLibrary
):
    """By the visual meshes, which physics has not seen: hulls are within 1 mm."""
    for scene in scenes.values():
        for i in range(3):
            for j in range(i):
                gap = mesh_gap(library, scene, i, j)
                if (j, i) in scene.edges:
                    assert -0.002 < gap < 0.0025
                else:
                    assert gap > 0.0


def mesh_gap(library: ObjectLibrary, scene: GeneratedScene, i: int, j: int) -> float:
    """Smallest signed distance of surface points of one from the other, m."""
    gaps = []
    for a, b in ((i, j), (j, i)):
        points, _ = library[scene.object_ids[a]].surface_sample(3000)
        X_BA = inverse(scene.X_WO[b]) @ scene.X_WO[a]
        field = registration_model(library[scene.object_ids[b]]).distance_field
        gaps.append(float(field.query(transform_points(X_BA, points))[0].min()))
    return min(gaps)


def test_nothing_is_below_the_surface(
    scenes: dict[int, GeneratedScene], library: ObjectLibrary
):
    for scene in scenes.values():
        lowest = [
            transform_points(X, library[i].mesh.vertices)[:, 2].min()
            for i, X in zip(scene.object_ids, scene.X_WO, strict=True)
        ]
        assert min(lowest) > -1.5e-3
        assert abs(min(lowest)) < 1.5e-3  # something stands on it


def test_scene_stays_when_it_is_simulated_again(
    scenes: dict[int, GeneratedScene],
    library: ObjectLibrary,
    files: dict[int, Path],
):
    """With a shorter time step, by which a thin round bottle rocks a little."""
    limits = RestLimits(0.02, 0.2, drift=1e-3, drift_angle=np.deg2rad(2.5))
    config = replace(SceneConfig().settling, time_step=0.002, limits=limits)
    for scene in scenes.values():
        plant = ScenePlant(
            [library[i] for i in scene.object_ids],
            [files[i] for i in scene.object_ids],
            load_container(scene.container),
            config,
        )
        for n, X_WO in enumerate(scene.X_WO):
            plant.set_pose(n, X_WO)
        assert pytest.approx(scene.X_WO, abs=0.04) == plant.hold().X_WO


def test_plant_measures_distances(library: ObjectLibrary, files: dict[int, Path]):
    """A cuboid 30 mm above the table and 20 mm beside another one."""
    box = library.by_name("kleenex_tissue_box")
    eraser = library.by_name("expo_dry_erase_board_eraser")
    plant = ScenePlant(
        [box, eraser],
        [files[box.object_id], files[eraser.object_id]],
        load_container(ContainerName.TABLE),
        SceneConfig().settling,
    )
    heights = [model.extents[2] / 2 for model in (box, eraser)]
    beside = (box.extents[0] + eraser.extents[0]) / 2 + 0.02
    plant.set_pose(0, pose_at([0, 0, heights[0] + 0.03]))
    plant.set_pose(1, pose_at([beside, 0, heights[0] + 0.03]))
    distances = plant.distances(0.05)
    assert distances[(0, 1)] == pytest.approx(0.02, abs=1e-4)
    assert distances[(CONTAINER, 0)] == pytest.approx(0.03, abs=1e-4)


def test_plant_refuses_what_does_not_rest(
    library: ObjectLibrary, files: dict[int, Path]
):
    """A ball beside the table's edge falls for ever."""
    ball = library.by_name("rawlings_baseball")
    plant = ScenePlant(
        [ball],
        [files[ball.object_id]],
        load_container(ContainerName.TABLE),
        SceneConfig().settling,
    )
    plant.set_pose(0, pose_at([3.0, 0.0, 0.1]))
    with pytest.raises(NotAtRestError, match="still moves"):
        plant.settle()


def pose_at(p: list[float]) -> np.ndarray:
    X = np.eye(4)
    X[:3, 3] = p
    return X


def test_same_seed_same_scene(library: ObjectLibrary):
    config = SceneConfig(2, 2, 2)
    first, second = (generate_scene(library, config, seed=8) for _ in range(2))
    assert first.object_ids == second.object_ids
    assert np.array_equal(first.X_WO, second.X_WO)


@pytest.mark.parametrize("container", [ContainerName.TOTE, ContainerName.SHELF])
def test_containers_hold_scenes(library: ObjectLibrary, container: ContainerName):
    scene = generate_scene(library, SceneConfig(2, 2, 3, container), seed=4)
    limit = load_container(container).half_extents
    for object_id, X_WO in zip(scene.object_ids, scene.X_WO, strict=True):
        points = transform_points(X_WO, library[object_id].mesh.vertices)
        assert (np.abs(points[:, :2]) <= limit + 1e-9).all()
        assert points[:, 2].max() < load_container(container).height


def test_level_needs_as_many_objects(library: ObjectLibrary):
    with pytest.raises(InputError, match="3 needs 3 objects"):
        check_scene_config(library, SceneConfig(3, 2, 2))


def test_no_more_objects_than_the_library_has(library: ObjectLibrary):
    with pytest.raises(InputError, match=r"up to 12.*has 11"):
        check_scene_config(library, SceneConfig(1, 2, 12))


def test_objects_occur_again_once_all_are_there(library: ObjectLibrary):
    few = ObjectLibrary([library[i] for i in (1, 2, 9)], "three of them")
    config = SceneConfig(1, 5, 5, repeats=True)
    scene = generate_scene(few, config, seed=0)
    assert set(scene.object_ids[:3]) == {1, 2, 9}
    assert len(scene.object_ids) == 5
    assert scene.levels == (1,) * 5
    assert len({X.tobytes() for X in scene.X_WO}) == 5


def test_a_pile_hangs_together(library: ObjectLibrary):
    few = ObjectLibrary([library[i] for i in (1, 2, 9)], "three of them")
    scene = generate_scene(few, SceneConfig(5, 5, 5, repeats=True), seed=0)
    assert scene.kinds == ("pile",)
    assert largest_group(5, scene.edges) >= 4
    assert max(scene.levels) == 3
    assert np.ptp(scene.X_WO[:, 2, 3]) > 0.02  # some lie on others


def test_many_objects_have_room(library: ObjectLibrary):
    scene = generate_scene(library, SceneConfig(1, 14, 14, repeats=True), seed=0)
    assert scene.levels == (1,) * 14
    assert set(Counter(scene.object_ids).values()) == {1, 2}


def test_a_wide_scene_of_many_is_looked_at_from_farther():
    X_WO = np.tile(np.eye(4), (8, 1, 1))
    few, near, wide = X_WO[:4].copy(), X_WO, X_WO.copy()
    few[1, 0, 3] = wide[1, 0, 3] = 0.9
    container = load_container(ContainerName.TABLE)
    heights = []
    for X in (few, near, wide):
        ids = tuple(range(1, len(X) + 1))
        scene = GeneratedScene(ids, X, (), (), (), ContainerName.TABLE, 1)
        rng = np.random.default_rng(0)
        heights.append(draw_camera(scene, container, ViewConfig(), rng)[2, 3])
    assert heights[0] == heights[1]
    assert heights[2] == pytest.approx(2 * heights[0], rel=0.05)


def test_model_too_large_for_the_surface():
    huge = ObjectModel.from_mesh(1, "plank", trimesh.creation.box([1.2, 0.1, 0.1]))
    library = ObjectLibrary([huge], "a folder")
    with pytest.raises(InputError, match=r"plank: is 1\.21 m across, but the table"):
        check_scene_config(library, SceneConfig(1, 1, 1))


def test_tries_are_limited(library: ObjectLibrary):
    """Objects that fill the shelf leave no room, and the message says so."""
    config = SceneConfig(1, 11, 11, ContainerName.SHELF, max_tries=2)
    with pytest.raises(PhysimError, match=r"no scene of level 1 in .* tries: no room"):
        generate_scene(library, config, seed=0)
