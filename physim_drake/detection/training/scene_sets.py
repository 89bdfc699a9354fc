# SPDX-License-Identifier: MIT
"""The scenes that networks learn from, and those they are judged on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from physim_drake.objects.containers import ContainerName
from physim_drake.objects.model import ObjectLibrary
from physim_drake.parallel.engine import Engine
from physim_drake.scenes.dataset import Progress, generate_dataset
from physim_drake.scenes.recording import DatasetConfig
from physim_drake.scenes.views import ViewConfig

DATA_FOLDER, TEST_FOLDER = "data", "test"

_TEST_SEED = 1_000_003  # added to the seed
_TEST_VIEWS = 2
_MAX_OBJECTS = 6

# Cameras 0.4 to 0.9 m above the surface, tilted every way.
_VIEW = ViewConfig(
    min_visible=0.1, height=(0.4, 0.9), max_roll=0.4, vivid=True, distractors=6
)


@dataclass(frozen=True)
class SceneSetConfig:
    """Generated images to train and to test with.

    Attributes:
        scenes: number of scenes to train with. 8 images of a scene cost about as much
            as the scene.
        views: images of each scene.
        test_images: number of images to test with, from scenes of their own.
        container: container that the objects stand on or in.
        seed: seed of all random choices.
    """

    scenes: int = 500
    views: int = 8
    test_images: int = 200
    container: ContainerName = ContainerName.TABLE
    seed: int = 0

    @property
    def test_scenes(self) -> int:
        """How many scenes the test images show."""
        return -(-self.test_images // _TEST_VIEWS)

    def dataset(self, objects: int, *, test: bool = False) -> DatasetConfig:
        """The scenes of one of the two sets, of a library of so many objects."""
        most = min(_MAX_OBJECTS, objects)
        return DatasetConfig(
            seed=self.seed + (_TEST_SEED if test else 0),
            levels=tuple(range(1, min(3, most) + 1)),
            min_objects=min(2, most),
            max_objects=most,
            container=self.container,
            views=_TEST_VIEWS if test else self.views,
            view=replace(_VIEW, min_visible=0.25) if test else _VIEW,
        )


def generate_scene_set(
    folder: Path,
    library: ObjectLibrary,
    config: SceneSetConfig,
    workers: int,
    progress: Progress = lambda done: None,
    *,
    test: bool = False,
    engine: Engine = Engine.LOCAL,
) -> Path:
    """Generates one of the two sets, or what is missing of it.

    Args:
        folder: folder of `data` or `test`.
        library: objects to find.
        config: size and content of the set.
        workers: number of processes.
        progress: callback for the number of scenes done.
        test: whether it is the test set.
        engine: engine that makes the scenes.

    Returns:
        the dataset, in BOP layout.

    Raises:
        InputError: if the settings are invalid or differ from those that an earlier
            run began with, or if files cannot be written.
        PhysimError: if a scene cannot be made.
    """
    root = folder / (TEST_FOLDER if test else DATA_FOLDER)
    generate_dataset(
        root,
        library,
        config.dataset(len(library), test=test),
        config.test_scenes if test else config.scenes,
        workers,
        resume=True,
        progress=progress,
        engine=engine,
    )
    return root
