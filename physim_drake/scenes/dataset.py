# SPDX-License-Identifier: MIT
"""Datasets of generated scenes in BOP layout, made by any number of workers.

Every scene appears whole, by one rename. The files about the whole dataset are made
from the scenes at the end, and ``generation.json`` gets its ``"complete": true`` last.
So an interrupted run leaves whole scenes and perhaps hidden scratch folders, and a
resumed run makes the rest.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from physim_drake.datasets.bop_writer import json_text, write_bop_models
from physim_drake.errors import InputError
from physim_drake.objects.containers import ContainerName, load_container
from physim_drake.objects.model import ObjectLibrary
from physim_drake.parallel.engine import Engine
from physim_drake.parallel.ray_pool import RayPool
from physim_drake.parallel.supervised_pool import SupervisedPool, SupervisionConfig
from physim_drake.scenes.directives import PACKAGE_XML
from physim_drake.scenes.generation import check_scene_config, write_models
from physim_drake.scenes.recording import (
    FACTS_FILE,
    MODELS_FOLDER,
    DatasetConfig,
    write_scene,
)
from physim_drake.storage.files import cannot_write, fill_folder, write_atomically
from physim_drake.storage.json_nodes import read_json
from physim_drake.storage.scratch import ScratchFolder

SPLIT = "test"
STATE_FILE = "generation.json"
# A scene takes seconds and a view less than one; a process that takes this much longer
# hangs, s.
_SCENE_LIMIT, _VIEW_LIMIT = 600.0, 30.0
Progress = Callable[[int], None]


def generate_dataset(
    root: Path,
    library: ObjectLibrary,
    config: DatasetConfig,
    scenes: int,
    workers: int = 1,
    resume: bool = False,
    progress: Progress = lambda done: None,
    engine: Engine = Engine.LOCAL,
) -> None:
    """Generates a dataset; the files do not depend on workers or interruptions.

    Args:
        root: folder of the dataset; it is made, and must be empty unless `resume`.
        library: objects to draw from.
        config: settings of the scenes.
        scenes: number of scenes; their ids count from 1.
        workers: number of processes; 1 uses this process. A cluster has its own number.
        resume: True to keep the scenes that an earlier run with the same settings made.
        progress: function that is called with the number of scenes done.
        engine: engine that makes the scenes.

    Raises:
        InputError: if the settings are impossible, or files cannot be written.
        PhysimError: if a scene cannot be made.
    """
    if scenes < 1 or config.views < 1 or workers < 1:
        raise InputError(
            "scenes, views and workers", "below 1", "give positive numbers"
        )
    if not config.levels:
        raise InputError("levels", "is empty", "give some of 1, 2, 3")
    for scene_id in range(1, min(scenes, len(config.levels)) + 1):
        check_scene_config(library, config.scene(scene_id))
    settings = _settings(library, config, scenes)
    split = root / SPLIT
    try:
        _begin(root, settings, resume)
        model_files = _write_models(root, library)
        done = {n for n in range(1, scenes + 1) if (split / f"{n:06d}").is_dir()}
        todo = [n for n in range(1, scenes + 1) if n not in done]
        progress(len(done))
        if engine is Engine.RAY:
            _run_on_cluster(split, library, config, todo, progress, len(done))
        else:
            maker = partial(SceneMaker, split, library, config, model_files)
            limit = _SCENE_LIMIT + _VIEW_LIMIT * config.views
            _run(split, maker, limit, todo, workers, progress, len(done))
        _finish(root, settings, scenes)
    except OSError as error:
        raise cannot_write(Path(error.filename or root), error) from error


def _settings(
    library: ObjectLibrary, config: DatasetConfig, scenes: int
) -> dict[str, Any]:
    """Settings that a resumed run must share, as they are when read back from JSON."""
    settings = {
        "scenes": scenes,
        **asdict(config),
        "objects": {str(i): library[i].name for i in library},
    }
    restored: dict[str, Any] = json.loads(json.dumps(settings))
    return restored


def _begin(root: Path, settings: dict[str, Any], resume: bool) -> None:
    """Makes the folder, or checks that an earlier run can go on in it."""
    state = root / STATE_FILE
    root.mkdir(parents=True, exist_ok=True)
    if any(root.iterdir()):
        if not resume:
            raise InputError(
                root, "is not empty", "choose a new folder, or --resume an earlier run"
            )
        if state.exists():
            earlier = read_json(state)
            for key, value in settings.items():
                if earlier["settings"].value.get(key) != value:
                    raise InputError(
                        state,
                        f"is {earlier['settings'].value.get(key)}, now {value}",
                        "resume with the settings of the earlier run",
                        f"settings.{key}",
                    )
        elif any(not path.name.startswith(".") for path in root.iterdir()):
            raise InputError(
                root, f"holds no {STATE_FILE}", "choose a folder made by generate"
            )
    for folder in (root, root / SPLIT):
        _remove_scratch(folder)
    if not state.exists():
        # First, since it marks what follows as files of this program.
        _write_state(root, settings, complete=False)
    (root / SPLIT).mkdir(exist_ok=True)


def _write_state(root: Path, settings: dict[str, Any], *, complete: bool) -> None:
    with write_atomically(root / STATE_FILE) as file:
        json.dump({"settings": settings, "complete": complete}, file, indent=1)
        file.write("\n")


def _write_models(root: Path, library: ObjectLibrary) -> dict[int, Path]:
    """Writes the models, unless an earlier run has; returns the SDF files."""
    models, drake_models = root / "models", root / MODELS_FOLDER
    if not models.is_dir():
        with fill_folder(models) as scratch:
            write_bop_models(scratch, library)
    if not drake_models.is_dir():
        with fill_folder(drake_models) as scratch:
            write_models(library, scratch)
            for name in ContainerName:
                shutil.copyfile(load_container(name).sdf, scratch / f"{name}.sdf")
    with write_atomically(root / "package.xml") as file:
        file.write(PACKAGE_XML)
    files = {}
    for object_id in library:
        folder = drake_models / f"obj_{object_id:06d}"
        files[object_id] = next(folder.glob("*.sdf"), folder)
        if files[object_id] == folder:
            raise InputError(
                folder, "holds no model", f"remove {drake_models}, and run again"
            )
    return files


class SceneMaker:
    """Makes the scenes of one dataset.

    Args:
        split: folder of the scenes.
        library: objects to draw from.
        config: settings of the scenes.
        model_files: SDF file of each object by its id.
    """

    def __init__(
        self,
        split: Path,
        library: ObjectLibrary,
        config: DatasetConfig,
        model_files: Mapping[int, Path],
    ) -> None:
        self._split, self._library = split, library
        self._config, self._model_files = config, model_files
        threadpool_limits(1)

    def make(self, scene_id: int) -> None:
        """Makes a scene, unless a process that died afterwards has made it."""
        if not (self._split / f"{scene_id:06d}").is_dir():
            write_scene(
                self._split, self._library, self._config, scene_id, self._model_files
            )


class SceneSender:
    """Makes scenes on a machine without the dataset's folder, and sends their files.

    Args:
        library: objects to draw from.
        config: settings of the scenes.
    """

    def __init__(self, library: ObjectLibrary, config: DatasetConfig) -> None:
        self._folder = ScratchFolder()
        root = self._folder.path
        files = _write_models(root, library)
        self._split = root / SPLIT
        self._split.mkdir()
        self._maker = SceneMaker(self._split, library, config, files)

    def make(self, scene_id: int) -> dict[str, bytes]:
        """The files of a scene, by their path in its folder."""
        self._maker.make(scene_id)
        folder = self._split / f"{scene_id:06d}"
        files = {
            str(path.relative_to(folder)): path.read_bytes()
            for path in sorted(folder.rglob("*"))
            if path.is_file()
        }
        shutil.rmtree(folder)
        return files


def _run(
    split: Path,
    maker: Callable[[], SceneMaker],
    time_limit: float,
    todo: list[int],
    workers: int,
    progress: Progress,
    done: int,
) -> None:
    """Makes the scenes `todo` on this machine."""
    if workers == 1:
        with threadpool_limits(1):
            here = maker()
            for n, scene_id in enumerate(todo, start=done + 1):
                here.make(scene_id)
                progress(n)
        return
    limits = SupervisionConfig(time_limit=time_limit)
    try:
        with SupervisedPool(maker, min(workers, max(len(todo), 1)), limits) as pool:
            made = pool.stream("make", [(scene_id,) for scene_id in todo])
            for n, _ in enumerate(made, start=done + 1):
                progress(n)
    finally:
        _remove_scratch(split)  # of processes that were ended


def _run_on_cluster(
    split: Path,
    library: ObjectLibrary,
    config: DatasetConfig,
    todo: list[int],
    progress: Progress,
    done: int,
) -> None:
    """Makes the scenes `todo` on a Ray cluster."""
    with RayPool(partial(SceneSender, library, config)) as pool:
        made = pool.stream("make", [(scene_id,) for scene_id in todo])
        for n, (index, files) in enumerate(made, start=done + 1):
            with fill_folder(split / f"{todo[index]:06d}") as scratch:
                for name, data in files.items():
                    path = scratch / name
                    path.parent.mkdir(parents=True, exist_ok=True)
                    path.write_bytes(data)
            progress(n)


def _remove_scratch(folder: Path) -> None:
    """Removes what was being written when a run was interrupted."""
    for path in folder.glob(".*.tmp"):
        shutil.rmtree(path) if path.is_dir() else path.unlink()


def _finish(root: Path, settings: dict[str, Any], scenes: int) -> None:
    """Writes the files about the whole dataset from those of its scenes."""
    targets, levels, detections = [], {}, []
    for scene_id in range(1, scenes + 1):
        facts = read_json(root / SPLIT / f"{scene_id:06d}" / FACTS_FILE).value
        images = range(len(facts["detections"]))
        levels[str(scene_id)] = {
            str(im_id): {str(k): level for k, level in enumerate(facts["levels"])}
            for im_id in images
        }
        for im_id in images:
            targets += [
                {
                    "im_id": im_id,
                    "inst_count": 1,
                    "obj_id": object_id,
                    "scene_id": scene_id,
                }
                for object_id in sorted(facts["objects"])
            ]
            detections += [
                {"scene_id": scene_id, "image_id": im_id, **entry, "time": 0.0}
                for entry in facts["detections"][im_id]
            ]
    for name, value in (
        ("levels.json", levels),
        ("detections.json", detections),
        ("test_targets_bop19.json", targets),
    ):
        with write_atomically(root / name) as file:
            file.write(json_text(value))
    _write_state(root, settings, complete=True)
