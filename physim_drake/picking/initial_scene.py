# SPDX-License-Identifier: MIT
"""What lies in the pick area when an episode begins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from physim_drake.errors import InputError
from physim_drake.objects.containers import ContainerName
from physim_drake.objects.model import ObjectLibrary
from physim_drake.picking.scenario import PickScenario
from physim_drake.poses import Array, transform_points
from physim_drake.scenes.config import SceneConfig
from physim_drake.scenes.generation import (
    GeneratedScene,
    check_scene_config,
    generate_scene,
)

_MAX_DRAWS = 30


@dataclass(frozen=True)
class PlacedModel:
    """An object of the simulation.

    Attributes:
        object_id: id of the object.
        sdf: Drake model, named after the object.
        X_WO: pose at the start, (4, 4).
        level: interaction level, 1 to 3.
    """

    object_id: int
    sdf: Path
    X_WO: Array
    level: int = 1


def scene_config(scenario: PickScenario, episode: int) -> SceneConfig:
    """What kind of scene an episode, from 0, begins with."""
    config = scenario.objects
    level = config.levels[episode % len(config.levels)]
    return SceneConfig(level, *config.count, container=config.container)


def check_objects(scenario: PickScenario, library: ObjectLibrary) -> None:
    """Checks that the scenes of a scenario can be made.

    Raises:
        InputError: if they cannot be made.
    """
    for episode in range(len(scenario.objects.levels)):
        check_scene_config(library, scene_config(scenario, episode))


def draw_start(
    scenario: PickScenario,
    library: ObjectLibrary,
    files: Mapping[int, Path],
    X_WA: Array,
    episode: int,
) -> tuple[PlacedModel, ...]:
    """Draws a settled scene that fits in the pick area.

    Args:
        scenario: which objects, how many, and how they depend on each other.
        library: the objects.
        files: Drake models of the objects, by id.
        X_WA: pose of the pick area, (4, 4).
        episode: number of the episode, from 0; decides the scene with the others.

    Raises:
        InputError: if no scene fits into the pick area.
        PhysimError: if no scene settles.
    """
    config = scene_config(scenario, episode)
    half = np.array(scenario.pick_area.half_extents)
    _check_area(library, config, half, scenario.pick_area.frame)
    for draw in range(_MAX_DRAWS):
        seed = np.random.SeedSequence([scenario.random_seed, episode, draw])
        scene = generate_scene(library, config, seed, files)
        low, high = _bounds(scene, library)
        shift = np.zeros(3)
        if config.container is ContainerName.TABLE:
            shift[:2] = -(low + high) / 2
        if (np.maximum(-low - shift[:2], high + shift[:2]) <= half).all():
            return _placed(scene, files, X_WA, shift)
    raise InputError(
        scenario.pick_area.frame,
        f"none of {_MAX_DRAWS} scenes fits into {2 * half[0]:g} x {2 * half[1]:g} m",
        "make the area larger, or ask for fewer or smaller objects",
        "half_extents",
    )


def _check_area(
    library: ObjectLibrary, config: SceneConfig, half: Array, name: str
) -> None:
    """Refuses an area that is smaller than too many objects, lying on any side."""
    widest = 2 * float(half.max())
    fits = [m for m in library.values() if np.sort(m.extents)[1] <= widest]
    if len(fits) < config.min_objects:
        raise InputError(
            name,
            f"{2 * half[0]:g} x {2 * half[1]:g} m is too small for the objects",
            "make the area larger",
            "half_extents",
        )


def _bounds(scene: GeneratedScene, library: ObjectLibrary) -> tuple[Array, Array]:
    """Least and largest x and y of all objects, (2,) each, m."""
    points = np.concatenate(
        [
            transform_points(X_WO, np.asarray(library[i].mesh.vertices))
            for i, X_WO in zip(scene.object_ids, scene.X_WO, strict=True)
        ]
    )
    return points[:, :2].min(axis=0), points[:, :2].max(axis=0)


def _placed(
    scene: GeneratedScene, files: Mapping[int, Path], X_WA: Array, shift: Array
) -> tuple[PlacedModel, ...]:
    placed = []
    for object_id, X_AO, level in zip(
        scene.object_ids, scene.X_WO, scene.levels, strict=True
    ):
        X_moved = X_AO.copy()
        X_moved[:3, 3] += shift
        placed.append(PlacedModel(object_id, files[object_id], X_WA @ X_moved, level))
    return tuple(placed)
