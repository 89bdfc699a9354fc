# SPDX-License-Identifier: MIT
"""Generates one scene: draws objects, places, settles and labels them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from physim_drake.errors import InputError, PhysimError
from physim_drake.objects.containers import (
    Container,
    ContainerName,
    load_container,
)
from physim_drake.objects.model import ObjectLibrary
from physim_drake.objects.sdformat import write_drake_model
from physim_drake.poses import Array
from physim_drake.scenes.config import SceneConfig, SettlingConfig
from physim_drake.scenes.contact_graph import (
    MAX_LEVEL,
    Pair,
    contact_edges,
    interaction_levels,
    largest_group,
)
from physim_drake.scenes.placement import NotPlacedError, Placer
from physim_drake.scenes.plant import NotAtRestError, RestingScene, ScenePlant
from physim_drake.storage.files import reading
from physim_drake.storage.scratch import ScratchFolder

_PLACEMENTS = 4  # tries with a set of objects before others are drawn
_TABLE_OBJECTS = 11  # that fit side by side into the usual area
_PILE_SHARE = 0.8  # of a pile that must be connected: a ball may roll off
_PILE_PENETRATION = 2.0  # times the penetration that is allowed elsewhere


@dataclass(frozen=True)
class GeneratedScene:
    """A scene at rest; W is the frame of its container.

    Attributes:
        object_ids: id of each object.
        X_WO: their poses, (N, 4, 4).
        edges: pairs of indices of objects that touch.
        levels: interaction level of each object, 1 to 3.
        kinds: kind of each group of objects, for instance "bridge".
        container: support of the objects.
        tries: number of scenes that were drawn until this one settled.
    """

    object_ids: tuple[int, ...]
    X_WO: Array
    edges: tuple[Pair, ...]
    levels: tuple[int, ...]
    kinds: tuple[str, ...]
    container: ContainerName
    tries: int


def check_scene_config(library: ObjectLibrary, config: SceneConfig) -> None:
    """Checks that scenes of this kind can be made of a library.

    Raises:
        InputError: if the level, the number of objects or an object's size is
            impossible.
    """
    if config.level < 1:
        raise InputError(
            "levels", f"holds {config.level}", "give 1, 2, 3, or more for a pile"
        )
    if not 1 <= config.min_objects <= config.max_objects:
        raise InputError(
            "objects",
            f"is {config.min_objects}:{config.max_objects}",
            "give MIN:MAX with 1 <= MIN <= MAX",
        )
    if config.max_objects < config.level:
        raise InputError(
            "levels",
            f"{config.level} needs {config.level} objects that depend on each other, "
            f"but scenes have at most {config.max_objects}",
            "allow more objects, or leave this level out",
        )
    if config.max_objects > len(library) and not config.repeats:
        raise InputError(
            "objects",
            f"asks for up to {config.max_objects}, but {library.source} has "
            f"{len(library)} and each is used once in a scene",
            "ask for fewer, or add models",
        )
    container = load_container(config.container)
    for model in library.values():
        if model.diameter > container.largest_object:
            raise InputError(
                model.source if model.source.name else model.name,
                f"is {model.diameter:.2f} m across, but the {container.name} takes "
                f"objects of up to {container.largest_object:.2f} m",
                "leave the model out, or check its unit",
            )


def generate_scene(
    library: ObjectLibrary,
    config: SceneConfig,
    seed: int | np.random.SeedSequence,
    model_files: Mapping[int, Path] | None = None,
) -> GeneratedScene:
    """Makes one scene; the same arguments make the same one.

    Args:
        library: objects to draw from.
        config: settings of the scene.
        seed: seed of all random choices.
        model_files: SDF file of each object by its id; None to write them first.

    Raises:
        InputError: as `check_scene_config`, or if a model no longer exists.
        PhysimError: if no try succeeds.
    """
    check_scene_config(library, config)
    if model_files is None:
        with ScratchFolder() as folder:
            return generate_scene(
                library, config, seed, write_models(library, folder.path)
            )
    rng = np.random.default_rng(seed)
    reasons: Counter[str] = Counter()
    tries = 0
    while tries < config.max_tries:
        plant, ids = _draw_objects(library, config, model_files, rng)
        for _ in range(_PLACEMENTS):
            tries += 1
            try:
                return _try_scene(plant, ids, config, rng, tries)
            except (NotPlacedError, NotAtRestError) as error:
                reasons[str(error)] += 1
    told = ", ".join(f"{reason} ({n})" for reason, n in reasons.most_common(3))
    raise PhysimError(f"no scene of level {config.level} in {tries} tries: {told}")


def write_models(library: ObjectLibrary, folder: Path) -> dict[int, Path]:
    """Writes the Drake model of every object; returns the SDF files by object id."""
    return {
        object_id: write_drake_model(model, folder / f"obj_{object_id:06d}")
        for object_id, model in library.items()
    }


def _draw_objects(
    library: ObjectLibrary,
    config: SceneConfig,
    model_files: Mapping[int, Path],
    rng: np.random.Generator,
) -> tuple[ScenePlant, tuple[int, ...]]:
    """A plant of some of the objects, and their ids."""
    fewest = max(config.min_objects, config.level)
    count = rng.integers(fewest, config.max_objects + 1)
    rounds = -(-int(count) // len(library))
    drawn = np.concatenate([rng.permutation(library.ids) for _ in range(rounds)])
    ids = tuple(int(i) for i in drawn[:count])
    files = [model_files[i] for i in ids]
    with reading([*files, *(path.with_suffix(".obj") for path in files)]):
        plant = ScenePlant(
            [library[i] for i in ids],
            files,
            load_container(config.container),
            _settling(config),
        )
    return plant, ids


def _settling(config: SceneConfig) -> SettlingConfig:
    """Settings for the level: a pile settles more slowly and penetrates deeper."""
    settling = config.settling
    if config.level <= MAX_LEVEL:
        return settling
    return replace(
        settling,
        max_time=settling.max_time * config.level / MAX_LEVEL,
        limits=replace(
            settling.limits, penetration=_PILE_PENETRATION * settling.limits.penetration
        ),
    )


def _try_scene(
    plant: ScenePlant,
    ids: tuple[int, ...],
    config: SceneConfig,
    rng: np.random.Generator,
    tries: int,
) -> GeneratedScene:
    container = _room(config.container, len(ids))
    for n in range(len(ids)):
        plant.park(n)
    kinds = Placer(plant, container, rng).place(_groups(len(ids), config.level))
    _check_level(plant.settle(), config)  # no use holding a wrong one
    rest = plant.hold()
    edges, levels = _check_level(rest, config)
    _check_inside(plant, rest, container)
    return GeneratedScene(ids, rest.X_WO, edges, levels, kinds, config.container, tries)


def _room(name: ContainerName, count: int) -> Container:
    """The container; on a table, more objects get a wider area."""
    container = load_container(name)
    if name is not ContainerName.TABLE:
        return container
    wider = max(1.0, count / _TABLE_OBJECTS) ** 0.5
    return replace(container, half_extents=wider * container.half_extents)


def _check_level(
    rest: RestingScene, config: SceneConfig
) -> tuple[tuple[Pair, ...], tuple[int, ...]]:
    """Contacts and levels; rejects a scene of another level than was asked for."""
    pile = config.level > MAX_LEVEL
    edges = _check_edges(rest, config, clear=not pile)
    if pile and largest_group(len(rest.X_WO), edges) < _PILE_SHARE * config.level:
        raise NotAtRestError("the pile came apart")
    levels = interaction_levels(len(rest.X_WO), edges)
    if max(levels) != min(config.level, MAX_LEVEL):
        raise NotAtRestError("another level came out")
    return edges, levels


def _groups(count: int, level: int) -> list[Sequence[int]]:
    """One group of `level` objects and the others alone."""
    return [range(level), *([k] for k in range(level, count))]


def _check_edges(
    rest: RestingScene, config: SceneConfig, *, clear: bool
) -> tuple[Pair, ...]:
    """Pairs of objects in contact; if `clear`, rejects a scene with an unclear pair.

    In a pile some objects always nearly touch, and its level does not depend on them.
    """
    settling = config.settling
    between = {pair: d for pair, d in rest.distances.items() if pair[0] >= 0}
    if clear and any(settling.touching < d < settling.apart for d in between.values()):
        raise NotAtRestError("objects nearly touch")
    return contact_edges(between, settling.touching)


def _check_inside(plant: ScenePlant, rest: RestingScene, container: Container) -> None:
    """Rejects a scene if part of an object lies outside the area for objects."""
    limit = container.half_extents
    for model, X_WO in zip(plant.objects, rest.X_WO, strict=True):
        points = model.mesh.vertices @ X_WO[:3, :3].T + X_WO[:3, 3]
        if (np.abs(points[:, :2]) > limit).any() or points[:, 2].max() > (
            container.height
        ):
            raise NotAtRestError("an object left the surface")
