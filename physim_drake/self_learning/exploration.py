# SPDX-License-Identifier: MIT
"""The robot looks at scenes by itself, and labels what it saw."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from physim_drake.closing import Closing
from physim_drake.datasets.bop_writer import (
    BopImage,
    json_text,
    write_bop_models,
)
from physim_drake.errors import InputError
from physim_drake.estimation.estimator import PoseEstimator
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.detector import DetectionAlgorithm, LabelImage
from physim_drake.observation.observation import RgbdObservation
from physim_drake.picking.cell import prepare_cell
from physim_drake.picking.initial_scene import PlacedModel, draw_start
from physim_drake.picking.look_postures import LookingConditions, looking_postures
from physim_drake.picking.scenario import PickScenario
from physim_drake.picking.scene_memory import NOTHING_KNOWN, merged
from physim_drake.poses import Array, inverse
from physim_drake.scene_estimate import SceneEstimate
from physim_drake.scenes.dataset import SPLIT
from physim_drake.scenes.generation import write_models
from physim_drake.self_learning.agreement import AgreedObject, EstimatedView
from physim_drake.self_learning.labels import (
    LabelledScene,
    SceneLearner,
    SelfLearningConfig,
    write_labelled_scene,
)
from physim_drake.self_learning.projection import ObjectArea, project_objects
from physim_drake.storage.files import (
    cannot_write,
    fill_folder,
    make_folder,
    write_atomically,
)
from physim_drake.storage.scratch import ScratchFolder
from physim_drake.systems.looking_cell import LookingCell
from physim_drake.systems.pick_cell import perception_config

LEARNING_FILE = "learning.json"

_AROUND = 0.05  # m, by which the area that may hold objects exceeds the pick area
_SEEN = 0.25  # of an object that a test image shows


@dataclass(frozen=True)
class ExplorationConfig:
    """How the robot looks at scenes.

    Attributes:
        views: number of views of a scene.
        workers: number of processes that estimate; the labels do not depend on it.
        seed: seed of all random choices, with the scene's number.
        learning: settings of what is taken for certain.
    """

    views: int = 4
    workers: int = 1
    seed: int = 0
    learning: SelfLearningConfig = field(default_factory=SelfLearningConfig)


class Explorer(Closing):
    """Looks at scenes from all around and learns from them.

    Args:
        scenario: the cell, and which objects come into it.
        conditions: lights and camera.
        config: number of views, workers and seed.

    Attributes:
        library: the objects.
        cell: what it looks at.

    Raises:
        InputError: if the scenario cannot work.

    Use it as a context manager, or call `close`.
    """

    def __init__(
        self,
        scenario: PickScenario,
        conditions: LookingConditions = LookingConditions(),  # noqa: B008 (frozen)
        config: ExplorationConfig = ExplorationConfig(),
    ) -> None:
        look = replace(scenario.look, camera=conditions.camera, workers=config.workers)
        self._scenario = replace(scenario, look=look, random_seed=config.seed)
        self._config = config
        prepared = prepare_cell(self._scenario)
        self.library, self._geometry = prepared.library, prepared.geometry
        self._folder = ScratchFolder()
        self._files = write_models(self.library, self._folder.path)
        self.cell = LookingCell(
            self._scenario, self.library, self._files, conditions, config.seed
        )
        self._estimator = PoseEstimator(
            self.library,
            perception_config(prepared, config.seed).estimator.estimation,
        )
        self._learner = SceneLearner(
            self.library,
            self._estimator,
            ObjectArea(
                self._geometry.X_WA,
                np.array(scenario.pick_area.half_extents) + _AROUND,
            ),
            config.learning,
        )

    def explore(self, number: int, detector: DetectionAlgorithm) -> LabelledScene:
        """Looks at a scene and labels its views, without the truth.

        Args:
            number: number of the scene, from 0.
            detector: finds objects in images.

        Raises:
            InputError: if no scene can be drawn.
        """
        _, rng = self._begin(number)
        known: SceneEstimate = NOTHING_KNOWN
        views: list[EstimatedView] = []
        self._geometry.planner.set_scene(known)
        for q in self._postures(rng):
            observation, labels = self.cell.look(q, self._look_number(number, views))
            found = detector.detect(observation, labels, rng)
            view = self._learner.estimated(observation, found)
            views.append(view)
            known = merged(known, replace(known, objects=view.estimates))
            # The next way goes around what was seen so far.
            self._geometry.planner.set_scene(known)
        return self._learner.labelled(views)

    def judged(self, number: int) -> tuple[BopImage, ...]:
        """Looks at a scene and takes the labels from the truth, for a test set.

        Args:
            number: number of the scene, from 0.

        Returns:
            images with those objects that show at least a quarter of themselves.
        """
        start, rng = self._begin(number)
        self._geometry.planner.set_scene(NOTHING_KNOWN)
        images: list[BopImage] = []
        for q in self._postures(rng):
            look = self._look_number(number, images)
            images.append(self._with_truth(start, *self.cell.look(q, look)))
        return tuple(image for image in images if image.object_ids)

    def close(self) -> None:
        """Ends worker processes and removes temporary files."""
        self._estimator.close()
        self._folder.close()

    def _begin(
        self, number: int
    ) -> tuple[tuple[PlacedModel, ...], np.random.Generator]:
        """Puts a scene's objects into the cell."""
        start = draw_start(
            self._scenario, self.library, self._files, self._geometry.X_WA, number
        )
        self.cell.place(start)
        return start, np.random.default_rng([self._config.seed, 4, number])

    def _postures(self, rng: np.random.Generator) -> Iterator[Array]:
        middle = self._geometry.X_WA[:3, 3]
        planner = self._geometry.planner
        return looking_postures(planner, middle, self._config.views, rng)

    def _look_number(self, number: int, earlier: Sequence[object]) -> int:
        return number * self._config.views + len(earlier)

    def _with_truth(
        self,
        start: Sequence[PlacedModel],
        observation: RgbdObservation,
        labels: LabelImage,
    ) -> BopImage:
        assert observation.X_WC is not None, "the arm's kinematics give it"
        objects = [AgreedObject(m.object_id, m.X_WO, 1.0, ()) for m in start]
        drawn = project_objects(objects, self.library, observation, np.inf)
        visible = self.cell.true_masks(labels, [m.object_id for m in start])
        whole = drawn.silhouettes | visible
        shown = np.flatnonzero(
            visible.sum(axis=(1, 2)) > _SEEN * whole.sum(axis=(1, 2))
        )
        X_CW = inverse(observation.X_WC)
        return BopImage(
            observation,
            [objects[int(n)].object_id for n in shown],
            np.reshape([X_CW @ objects[int(n)].X_WO for n in shown], (-1, 4, 4)),
            whole[shown],
            visible[shown],
        )


def explore_scenes(
    explorer: Explorer,
    detector: DetectionAlgorithm,
    out: Path,
    scenes: int,
    progress: Callable[[int, LabelledScene], None] = lambda number, scene: None,
) -> dict[str, Any]:
    """Looks at scenes and writes the labelled views as a dataset in BOP layout.

    Args:
        explorer: looks at the scenes.
        detector: finds objects in images.
        out: folder of the dataset, which is made and must be empty.
        scenes: number of scenes.
        progress: called with each scene's number and labels.

    Returns:
        the figures, which `learning.json` in the folder also holds.

    Raises:
        InputError: if no scene can be drawn, or files cannot be written.
    """
    with _new_dataset(out, explorer.library) as split:
        facts = []
        for number in range(scenes):
            scene = explorer.explore(number, detector)
            if scene.images:
                write_labelled_scene(split, number + 1, scene.images, explorer.library)
            facts.append(
                {
                    "scene": number + 1,
                    "objects": [o.object_id for o in scene.objects],
                    "images": len(scene.images),
                    "labels": scene.labels,
                    "missed": scene.missed,
                }
            )
            progress(number, scene)
        figures: dict[str, Any] = {
            "images": sum(f["images"] for f in facts),
            "labels": sum(f["labels"] for f in facts),
            "missed": sum(f["missed"] for f in facts),
            "scenes": facts,
        }
        with write_atomically(out / LEARNING_FILE) as file:
            file.write(json_text(figures))
    return figures


def write_judged_scenes(explorer: Explorer, out: Path, scenes: int) -> None:
    """Looks at scenes and writes the views with true labels, to judge detectors by.

    Args:
        explorer: looks at the scenes.
        out: folder of the dataset, which is made and must be empty.
        scenes: number of scenes.

    Raises:
        InputError: if no scene can be drawn, or files cannot be written.
    """
    with _new_dataset(out, explorer.library) as split:
        for number in range(scenes):
            images = explorer.judged(number)
            if images:
                write_labelled_scene(split, number + 1, images, explorer.library)


@contextmanager
def _new_dataset(out: Path, library: ObjectLibrary) -> Iterator[Path]:
    """Makes a dataset with models and yields the folder for its scenes."""
    make_folder(out)
    if any(out.iterdir()):
        raise InputError(out, "is not empty", "choose a new folder")
    try:
        with fill_folder(out / "models") as scratch:
            write_bop_models(scratch, library)
        make_folder(out / SPLIT)
        yield out / SPLIT
    except OSError as error:
        raise cannot_write(out, error) from error
