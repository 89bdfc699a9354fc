# SPDX-License-Identifier: MIT
"""Makes one scene with its images, and writes its folder.

A scene depends only on the seed of the dataset and its own number, so that any worker
can make it.
"""

from __future__ import annotations

import gc
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from physim_drake.datasets.bop_writer import BopImage, write_bop_scene, write_json
from physim_drake.errors import PhysimError
from physim_drake.objects.containers import ContainerName
from physim_drake.objects.model import ObjectLibrary
from physim_drake.rendering.appearance import Appearance
from physim_drake.scenes.config import SceneConfig
from physim_drake.scenes.directives import scene_directives
from physim_drake.scenes.generation import GeneratedScene, generate_scene
from physim_drake.scenes.views import (
    NotSeenError,
    SceneView,
    ViewConfig,
    find_view,
    jittered_detections,
    make_renderer,
    make_vivid_renderer,
    render_view,
)
from physim_drake.sensors.color_noise import ColorNoise
from physim_drake.sensors.depth_noise import DepthNoise
from physim_drake.storage.files import fill_folder, reading

FACTS_FILE = "scene_facts.json"
MODELS_FOLDER = "drake_models"
_MAX_REDRAWS = 20


@dataclass(frozen=True)
class DatasetConfig:
    """Settings of a dataset.

    Attributes:
        seed: seed of all random choices.
        levels: interaction levels, which the scenes take in turn.
        min_objects: least number of objects in a scene.
        max_objects: greatest number of objects in a scene.
        container: support of the objects.
        views: number of images of a scene.
        view: settings of the images.
    """

    seed: int = 0
    levels: tuple[int, ...] = (1, 2, 3)
    min_objects: int = 2
    max_objects: int = 4
    container: ContainerName = ContainerName.TABLE
    views: int = 1
    view: ViewConfig = field(default_factory=ViewConfig)

    def scene(self, scene_id: int) -> SceneConfig:
        """The settings of one scene."""
        return SceneConfig(
            self.levels[(scene_id - 1) % len(self.levels)],
            self.min_objects,
            self.max_objects,
            self.container,
            repeats=True,
        )


@dataclass(frozen=True)
class SceneRecord:
    """A scene, its images and a detector's detections in them."""

    scene: GeneratedScene
    views: tuple[SceneView, ...]
    detections: tuple[tuple[dict[str, Any], ...], ...]


def record_scene(
    library: ObjectLibrary,
    config: DatasetConfig,
    scene_id: int,
    model_files: Mapping[int, Path],
) -> SceneRecord:
    """Makes scene `scene_id` of a dataset and its images.

    Args:
        library: objects to draw from.
        config: settings of the dataset.
        scene_id: number of the scene, from 1.
        model_files: SDF file of each object by its id; its visual OBJ is beside it.

    Raises:
        InputError: as `check_scene_config`, or if a model no longer exists.
        PhysimError: if no scene, or no view of one, is found.
    """
    for redraw in range(_MAX_REDRAWS):
        seeds = np.random.SeedSequence(config.seed, spawn_key=(scene_id, redraw)).spawn(
            2
        )
        scene = generate_scene(library, config.scene(scene_id), seeds[0], model_files)
        rng = np.random.default_rng(seeds[1])
        try:
            with reading(path.with_suffix(".obj") for path in model_files.values()):
                return _look_at(scene, library, config, model_files, rng)
        except NotSeenError:
            continue
    raise PhysimError(
        f"scene {scene_id}: in {_MAX_REDRAWS} scenes some object always shows less "
        f"than {config.view.min_visible:.0%} of itself"
    )


def write_scene(
    split: Path,
    library: ObjectLibrary,
    config: DatasetConfig,
    scene_id: int,
    model_files: Mapping[int, Path],
) -> None:
    """Writes scene `scene_id` below `split`, whole or not at all.

    Raises:
        InputError: if it cannot be written.
        PhysimError: as `record_scene`.
    """
    record = record_scene(library, config, scene_id, model_files)
    with fill_folder(split / f"{scene_id:06d}") as scratch:
        names = {object_id: library[object_id].name for object_id in library}
        write_bop_scene(scratch, _images(record), names)
        uris = {
            object_id: f"{MODELS_FOLDER}/{path.parent.name}/{path.name}"
            for object_id, path in model_files.items()
        }
        text = scene_directives(record.scene, uris)
        (scratch / "scene.dmd.yaml").write_text(text, encoding="utf-8")
        write_json(scratch / FACTS_FILE, _facts(record))


def _look_at(
    scene: GeneratedScene,
    library: ObjectLibrary,
    config: DatasetConfig,
    model_files: Mapping[int, Path],
    rng: np.random.Generator,
) -> SceneRecord:
    visuals = [model_files[i].with_suffix(".obj") for i in scene.object_ids]
    view_config = config.view
    shared = None
    if not view_config.vivid:
        shared = make_renderer(scene, visuals, Appearance.draw(rng))
    views, detections = [], []
    for _ in range(config.views):
        renderer = shared
        if renderer is None:
            models = [library[i] for i in scene.object_ids]
            renderer = make_vivid_renderer(
                scene, visuals, models, view_config.distractors, rng
            )
        X_WC = find_view(scene, renderer, view_config, rng)
        view = render_view(
            scene,
            renderer,
            X_WC,
            rng,
            view_config.preset,
            None if view_config.noise else DepthNoise.none(),
            ColorNoise() if view_config.noise else None,
        )
        views.append(view)
        detections.append(_detections(view, scene.object_ids, view_config, rng))
    if view_config.vivid:
        # Drake's renderers are in cycles that hold memory Python does not see.
        gc.collect()
    return SceneRecord(scene, tuple(views), tuple(detections))


def _detections(
    view: SceneView,
    object_ids: Sequence[int],
    config: ViewConfig,
    rng: np.random.Generator,
) -> tuple[dict[str, Any], ...]:
    """BOP detections of one image, without the ids of scene and image."""
    return tuple(
        {
            "category_id": d.object_id,
            "bbox": [
                round(float(x), 2)
                for x in (*d.box[:2], d.box[2] - d.box[0], d.box[3] - d.box[1])
            ],
            "score": round(d.score, 4),
        }
        for d in jittered_detections(view, object_ids, config.box_jitter, rng)
    )


def _images(record: SceneRecord) -> list[BopImage]:
    return [
        BopImage(
            view.observation,
            record.scene.object_ids,
            view.X_CO,
            view.silhouettes,
            view.visible,
        )
        for view in record.views
    ]


def _facts(record: SceneRecord) -> dict[str, Any]:
    scene = record.scene
    return {
        "objects": scene.object_ids,
        "levels": scene.levels,
        "edges": scene.edges,
        "kinds": scene.kinds,
        "container": str(scene.container),
        "tries": scene.tries,
        "detections": record.detections,
    }
