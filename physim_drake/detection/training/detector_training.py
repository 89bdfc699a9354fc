# SPDX-License-Identifier: MIT
"""From object models to a trained detector: scenes, packed images, training, test."""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import cv2
import torch
from torch import Tensor, nn

from physim_drake.datasets.bop import BopDataset
from physim_drake.detection.accuracy import evaluate_detector
from physim_drake.detection.average_precision import AveragePrecision
from physim_drake.detection.detector import NetworkDetector
from physim_drake.detection.networks.config import NetworkConfig
from physim_drake.detection.networks.factory import Network, classes_of, make_network
from physim_drake.detection.networks.weights import (
    load_weights,
    mix_weights,
    save_weights,
    start_from,
)
from physim_drake.detection.training.augmentation import AugmentationConfig, Augmenter
from physim_drake.detection.training.packed_images import (
    MixedImages,
    TrainingImages,
    pack_images,
)
from physim_drake.detection.training.scene_sets import (
    SceneSetConfig,
    generate_scene_set,
)
from physim_drake.detection.training.trainer import Trainer, TrainingConfig
from physim_drake.detection.training.training_log import TrainingLog
from physim_drake.errors import InputError
from physim_drake.objects.model import ObjectLibrary
from physim_drake.parallel.engine import Engine
from physim_drake.storage.files import make_folder

WEIGHTS_FILE, STATE_FILE, PACKED_FOLDER = (
    "detector.safetensors",
    "state.safetensors",
    "packed",
)

# Size of packed images by that of the network's, since zooming in needs more.
_PACKED_SIDE = 8 / 7
_QUICK_TEST = 50  # images of a test on the way

Progress = Callable[[str, int, int, str], None]
"""Is told a stage, how much of it is done, of how much, and what else is to be said."""


@dataclass(frozen=True)
class TrainDetectorConfig:
    """Everything that can be set about training a detector.

    Attributes:
        scenes: scenes to generate.
        network: network to train.
        training: course of the training.
        augmentation: changes of the images.
        data: datasets with visible masks to learn from, instead of generated scenes.
            Each counts the same, however large it is.
        start: weights to start from, of any objects, instead of random ones.
        start_share: share of the start's weights that the result keeps (see
            `mix_weights`). They must be for the same objects.
    """

    scenes: SceneSetConfig = field(default_factory=SceneSetConfig)
    network: NetworkConfig = field(default_factory=NetworkConfig)
    training: TrainingConfig = field(default_factory=TrainingConfig)
    augmentation: AugmentationConfig = field(default_factory=AugmentationConfig)
    data: tuple[Path, ...] = ()
    start: Path | None = None
    start_share: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.start_share < 1:
            raise InputError(
                "training",
                f"is {self.start_share:g}",
                "give a number from 0 to below 1",
                "start_share",
            )
        if self.start_share and self.start is None:
            raise InputError(
                "training",
                "is given without weights to start from",
                "give those, too",
                "start_share",
            )


class DetectorTraining:
    """A training run in a folder.

    Args:
        out: folder of the run. It is made, and must be empty unless `resume` is set.
        library: objects to find.
        config: configuration of the run.
        workers: number of processes that generate scenes.
        device: device to train on.
        resume: whether to continue an earlier run.
        progress: callback for the progress.
        engine: engine that generates scenes.
    """

    def __init__(
        self,
        out: Path,
        library: ObjectLibrary,
        config: TrainDetectorConfig,
        workers: int = 1,
        device: torch.device | None = None,
        resume: bool = False,
        progress: Progress = lambda stage, done, total, text: None,
        engine: Engine = Engine.LOCAL,
    ) -> None:
        if len(library) == 0:
            raise InputError(library.source, "holds no object", "give object models")
        self._out, self._library, self._config = out, library, config
        self._workers, self._progress, self._engine = workers, progress, engine
        self._device = torch.device("cpu") if device is None else device
        self._classes = classes_of(library)
        make_folder(out)
        if any(out.iterdir()) and not resume:
            raise InputError(
                out, "is not empty", "choose a new folder, or --resume an earlier run"
            )

    def run(self) -> AveragePrecision:
        """Makes what is missing, trains, and evaluates the result on the test images.

        Raises:
            InputError: if settings, files or data cannot be used.
            PhysimError: if a scene cannot be made.
        """
        log = TrainingLog(self._out, self._settings())
        network = self._network()
        first, share = self._first_weights(network), self._config.start_share
        images = self._images(self._data())
        test = BopDataset(self._generate(test=True))
        labels = {c.object_id: k for k, c in enumerate(self._classes, start=1)}
        size = _sample_size(images, self._config.network.image_size)
        augmenter = Augmenter(
            images, labels, size, self._config.augmentation, self._config.training.seed
        )
        cv2.setNumThreads(1)  # torch has the cores
        trainer = Trainer(
            network,
            augmenter,
            self._config.training,
            self._device,
            self._out / STATE_FILE,
            log,
        )
        trainer.run(
            lambda weights: save_weights(
                self._out / WEIGHTS_FILE,
                mix_weights(weights, first, share) if share else weights,
                self._config.network,
                self._classes,
            ),
            lambda averaged, step: self._test(averaged, test, step, log),
            lambda step, losses: self._tell(step, losses, log),
        )
        result, _ = evaluate_detector(
            NetworkDetector.load(self._out / WEIGHTS_FILE), test, test.images()
        )
        log.tests = [e for e in log.tests if e["step"] < trainer.step]
        log.add_test(trainer.step, result, len(test.images()))
        log.write()
        return result

    def _network(self) -> Network:
        config = self._config
        torch.manual_seed(config.training.seed)
        network = make_network(config.network, len(self._classes))
        if config.start is not None:
            start_from(network, config.start)
        return network

    def _first_weights(self, network: Network) -> dict[str, Tensor]:
        """The weights that the result keeps a share of, empty if it keeps none."""
        start = self._config.start
        if start is None or not self._config.start_share:
            return {}
        if load_weights(start).classes != self._classes:
            raise InputError(
                start,
                "are weights for other objects, so that no share of them can be kept",
                "start from weights for these objects, or keep no share",
            )
        return {k: v.clone() for k, v in network.state_dict().items()}

    def _data(self) -> list[BopDataset]:
        if not self._config.data:
            return [BopDataset(self._generate(test=False))]
        return [BopDataset(path) for path in self._config.data]

    def _images(self, data: list[BopDataset]) -> TrainingImages | MixedImages:
        folder = self._out / PACKED_FOLDER
        if len(data) == 1:
            return self._pack(data[0], folder)
        packed = [self._pack(d, folder / str(n)) for n, d in enumerate(data, start=1)]
        return MixedImages(packed)

    def _generate(self, *, test: bool) -> Path:
        scenes = self._config.scenes
        total = scenes.test_scenes if test else scenes.scenes
        stage = "test scenes" if test else "scenes"
        root = generate_scene_set(
            self._out,
            self._library,
            scenes,
            self._workers,
            lambda done: self._progress(stage, done, total, ""),
            test=test,
            engine=self._engine,
        )
        gc.collect()  # renderers hold contexts of the graphics library
        return root

    def _pack(self, data: BopDataset, folder: Path) -> TrainingImages:
        total = len(data.images())
        return pack_images(
            data,
            folder,
            round(self._config.network.image_size * _PACKED_SIDE),
            self._config.network.channels == 4,
            lambda done: self._progress("packed images", done, total, ""),
            {c.object_id for c in self._classes},
        )

    def _test(
        self, network: nn.Module, test: BopDataset, step: int, log: TrainingLog
    ) -> None:
        images = test.images()[:_QUICK_TEST]
        channels = self._config.network.channels
        detector = NetworkDetector(
            network, self._classes, channels, device=self._device
        )
        result, _ = evaluate_detector(detector, test, images)
        log.add_test(step, result, len(images))
        self._progress("test", step, self._config.training.steps, str(result))

    def _tell(self, step: int, losses: dict[str, float], log: TrainingLog) -> None:
        text = " ".join(
            f"{name.removeprefix('loss_')} {value:.3f}"
            for name, value in losses.items()
        )
        self._progress("steps", step, self._config.training.steps, text)

    def _settings(self) -> dict[str, object]:
        config = self._config
        return {
            "classes": [asdict(c) for c in self._classes],
            "network": config.network.as_dict(),
            "training": asdict(config.training),
            "augmentation": asdict(config.augmentation),
            "scenes": asdict(config.scenes),
            "data": [str(path.resolve()) for path in config.data] or None,
            "start": None if config.start is None else str(config.start.resolve()),
            "start_share": config.start_share,
        }


def _sample_size(
    images: TrainingImages | MixedImages, longer_side: int
) -> tuple[int, int]:
    """Height and width of samples: the shape of the images, the network's size."""
    height, width = images.size
    factor = longer_side / max(height, width)
    return round(height * factor), round(width * factor)
