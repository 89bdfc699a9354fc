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
from physim_drake.detection.networks.factory import (
    Network,
    ObjectClass,
    classes_of,
    make_network,
)
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

_PACKED_SIDE = 8 / 7  # packed images by those of the network; zooming in needs more
_CPU = torch.device("cpu")
_QUICK_TEST = 50  # images of a test on the way

Progress = Callable[[str, int, int, str], None]
"""Is told a stage, how much of it is done, of how much, and what else is to be said."""


@dataclass(frozen=True)
class TrainDetectorConfig:
    """Everything that can be set about training a detector.

    Attributes:
        scenes: settings of the generated scenes.
        network: network that learns.
        training: how.
        augmentation: random changes of images.
        data: datasets with visible masks to learn from, instead of generated scenes;
            each counts the same, however large it is.
        start: weights to start from, of any objects, instead of random ones.
        start_share: of the weights it started from that the result keeps; see
            `mix_weights`. They must be of the same objects.
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


def _untold(stage: str, done: int, total: int, text: str) -> None:
    """Progress that is not shown."""


@dataclass(frozen=True)
class DetectorTrainingJob:
    """A training run in a folder.

    Attributes:
        out: folder of the run; is made, and must be empty without `resume`.
        library: the objects to find.
        config: settings of the run.
        workers: number of processes that generate scenes.
        device: device that the network learns on.
        resume: whether to go on with what an earlier run left.
        engine: machine or cluster that generates scenes.
        progress: callback for the progress.
    """

    out: Path
    library: ObjectLibrary
    config: TrainDetectorConfig
    workers: int = 1
    device: torch.device = _CPU
    resume: bool = False
    engine: Engine = Engine.LOCAL
    progress: Progress = _untold

    @property
    def classes(self) -> tuple[ObjectClass, ...]:
        """The objects as the network numbers them, from 1."""
        return classes_of(self.library)


def train_detector(job: DetectorTrainingJob) -> AveragePrecision:
    """Makes what is missing, trains, and judges the result on the test images.

    Raises:
        InputError: if settings, files or data cannot be used.
        PhysimError: if a scene cannot be made.
    """
    _check(job)
    log = TrainingLog(job.out, _settings(job))
    network = _network(job)
    first, share = _first_weights(job, network), job.config.start_share
    images = _images(job, _data(job))
    test = BopDataset(_generate(job, test=True))
    labels = {c.object_id: k for k, c in enumerate(job.classes, start=1)}
    size = _sample_size(images, job.config.network.image_size)
    augmenter = Augmenter(
        images, labels, size, job.config.augmentation, job.config.training.seed
    )
    cv2.setNumThreads(1)  # torch has the cores
    trainer = Trainer(
        network,
        augmenter,
        job.config.training,
        job.device,
        job.out / STATE_FILE,
        log,
    )
    trainer.run(
        lambda weights: save_weights(
            job.out / WEIGHTS_FILE,
            mix_weights(weights, first, share) if share else weights,
            job.config.network,
            job.classes,
        ),
        lambda averaged, step: _test(job, averaged, test, step, log),
        lambda step, losses: _tell(job, step, losses, log),
    )
    result, _ = evaluate_detector(
        NetworkDetector.load(job.out / WEIGHTS_FILE), test, test.images()
    )
    log.tests = [e for e in log.tests if e["step"] < trainer.step]
    log.add_test(trainer.step, result, len(test.images()))
    log.write()
    return result


def _check(job: DetectorTrainingJob) -> None:
    """Makes the folder; refuses one that holds something else, and an empty library."""
    if len(job.library) == 0:
        raise InputError(job.library.source, "holds no object", "give object models")
    make_folder(job.out)
    if any(job.out.iterdir()) and not job.resume:
        raise InputError(
            job.out, "is not empty", "choose a new folder, or --resume an earlier run"
        )


def _network(job: DetectorTrainingJob) -> Network:
    config = job.config
    torch.manual_seed(config.training.seed)
    network = make_network(config.network, len(job.classes))
    if config.start is not None:
        start_from(network, config.start)
    return network


def _first_weights(job: DetectorTrainingJob, network: Network) -> dict[str, Tensor]:
    """The weights that the result keeps a share of, or an empty mapping."""
    start = job.config.start
    if start is None or not job.config.start_share:
        return {}
    if load_weights(start).classes != job.classes:
        raise InputError(
            start,
            "are weights for other objects, so that no share of them can be kept",
            "start from weights for these objects, or keep no share",
        )
    return {k: v.clone() for k, v in network.state_dict().items()}


def _data(job: DetectorTrainingJob) -> list[BopDataset]:
    if not job.config.data:
        return [BopDataset(_generate(job, test=False))]
    return [BopDataset(path) for path in job.config.data]


def _images(
    job: DetectorTrainingJob, data: list[BopDataset]
) -> TrainingImages | MixedImages:
    folder = job.out / PACKED_FOLDER
    if len(data) == 1:
        return _pack(job, data[0], folder)
    packed = [_pack(job, d, folder / str(n)) for n, d in enumerate(data, start=1)]
    return MixedImages(packed)


def _generate(job: DetectorTrainingJob, *, test: bool) -> Path:
    scenes = job.config.scenes
    total = scenes.test_scenes if test else scenes.scenes
    stage = "test scenes" if test else "scenes"
    root = generate_scene_set(
        job.out,
        job.library,
        scenes,
        job.workers,
        lambda done: job.progress(stage, done, total, ""),
        test=test,
        engine=job.engine,
    )
    gc.collect()  # renderers hold contexts of the graphics library
    return root


def _pack(job: DetectorTrainingJob, data: BopDataset, folder: Path) -> TrainingImages:
    total = len(data.images())
    return pack_images(
        data,
        folder,
        round(job.config.network.image_size * _PACKED_SIDE),
        job.config.network.channels == 4,
        lambda done: job.progress("packed images", done, total, ""),
        {c.object_id for c in job.classes},
    )


def _test(
    job: DetectorTrainingJob,
    network: nn.Module,
    test: BopDataset,
    step: int,
    log: TrainingLog,
) -> None:
    images = test.images()[:_QUICK_TEST]
    channels = job.config.network.channels
    detector = NetworkDetector(network, job.classes, channels, device=job.device)
    result, _ = evaluate_detector(detector, test, images)
    log.add_test(step, result, len(images))
    job.progress("test", step, job.config.training.steps, str(result))


def _tell(
    job: DetectorTrainingJob,
    step: int,
    losses: dict[str, float],
    log: TrainingLog,
) -> None:
    text = " ".join(
        f"{name.removeprefix('loss_')} {value:.3f}" for name, value in losses.items()
    )
    job.progress("steps", step, job.config.training.steps, text)


def _settings(job: DetectorTrainingJob) -> dict[str, object]:
    config = job.config
    return {
        "classes": [asdict(c) for c in job.classes],
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
