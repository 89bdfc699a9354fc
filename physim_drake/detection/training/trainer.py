# SPDX-License-Identifier: MIT
"""Training: the same for every network that is called as torchvision's detectors are.

Everything random in a step is drawn from the seed and the step's number, so that a run
that was cut off and resumed ends with the weights of one that was not.
"""

from __future__ import annotations

import copy
import math
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from physim_drake.detection.networks.devices import mixed_precision
from physim_drake.detection.training.augmentation import Augmenter, Sample
from physim_drake.detection.training.checkpoints import AveragedWeights, TrainingState
from physim_drake.detection.training.training_log import TrainingLog

_PREFETCHED = 3  # batches
_LEAST_RATE = 0.01  # of the learning rate, in the last step


@dataclass(frozen=True)
class TrainingConfig:
    """How a network learns.

    Attributes:
        steps: number of steps in all.
        batch: images per step.
        learning_rate: highest learning rate. It is reached after `warmup` steps and
            then falls as a cosine.
        warmup: steps in which the learning rate rises.
        weight_decay: weight decay of AdamW.
        max_gradient: norm to which longer gradients are shortened.
        log_every: steps between entries of the log.
        save_every: steps between saved states, and so the most that are lost when a
            run is cut off. An interrupt does not save: a state in
            the middle of a step is not one that an unbroken run would have.
        test_every: steps between tests.
        seed: seed of all random choices.
        bfloat16: whether products are done with 16 bits.
        calm: share of the steps, at the end, in which images are changed little, so
            that the network ends with images as they will be (Ge et al., "YOLOX",
            2021, end without their strongest changes, too).
    """

    steps: int = 4500
    batch: int = 8
    learning_rate: float = 1e-3
    warmup: int = 300
    weight_decay: float = 0.02
    max_gradient: float = 5.0
    log_every: int = 20
    save_every: int = 200
    test_every: int = 1000
    seed: int = 0
    bfloat16: bool = False
    calm: float = 0.2

    def rate(self, step: int) -> float:
        """The learning rate of a step, from 0."""
        rising = min((step + 1) / self.warmup, 1.0)
        done = max(step - self.warmup, 0) / max(self.steps - self.warmup, 1)
        falling = _LEAST_RATE + (1 - _LEAST_RATE) * (1 + math.cos(math.pi * done)) / 2
        return self.learning_rate * rising * falling


Save = Callable[[dict[str, Tensor]], None]
Test = Callable[[nn.Module, int], None]
Report = Callable[[int, dict[str, float]], None]


class Trainer:
    """Trains a network, saving its state now and then.

    Args:
        network: network to train. It gives losses by name for images and targets.
        augmenter: source of its samples.
        config: configuration of the training.
        device: device to train on.
        state_path: file of the state. The run resumes from it if it exists.
        log: log of losses.

    Attributes:
        step: number of steps done.
        network: network that is trained.
        average: average of its weights, which are the ones to use.
    """

    def __init__(
        self,
        network: nn.Module,
        augmenter: Augmenter,
        config: TrainingConfig,
        device: torch.device,
        state_path: Path,
        log: TrainingLog,
    ) -> None:
        self.network = network.to(device).train()
        self.average = AveragedWeights(self.network)
        self.step = 0
        self._recent: list[dict[str, float]] = []
        self._augmenter, self._config, self._device = augmenter, config, device
        self._path, self._log = state_path, log
        self._optimizer = torch.optim.AdamW(
            _groups(network, config.weight_decay), lr=config.learning_rate
        )
        self._state = TrainingState(self.network, self.average, self._optimizer)
        if state_path.exists():
            self.step, self._recent = self._state.load(state_path, log.settings)
        log.cut(self.step)  # it is written before the state

    def run(self, save: Save, test: Test, report: Report) -> None:
        """Trains to the last step.

        Args:
            save: function that writes the averaged weights, called with each state.
            test: function that judges a network with the averaged weights, called after
                so many steps.
            report: callback for the losses after so many steps.

        Raises:
            InputError: if a file cannot be written.
        """
        config = self._config
        begun = time.monotonic() - self._log.seconds
        with _samples(self._augmenter, config, self.step) as batches:
            for samples in batches:
                self._recent.append(self._learn(samples))
                self.step += 1
                self._log.seconds = time.monotonic() - begun
                last = self.step == config.steps
                if self.step % config.log_every == 0 or last:
                    means = self._mean_losses()
                    self._log.add_losses(self.step, config.rate(self.step - 1), means)
                    report(self.step, means)
                    self._recent = []
                if self.step % config.test_every == 0 or last:
                    test(self.averaged_network(), self.step)
                if self.step % config.save_every == 0 or last:
                    self._save(save)

    def averaged_network(self) -> nn.Module:
        """A copy of the network with the averaged weights."""
        network = copy.deepcopy(self.network)
        network.load_state_dict(self.average.values)
        return network.eval()

    def _save(self, save: Save) -> None:
        self._log.write()
        save(self.average.values)
        self._state.save(self._path, self.step, self._log.settings, self._recent)

    def _mean_losses(self) -> dict[str, float]:
        """Of the steps since the log was told last."""
        count = len(self._recent)
        return {
            name: sum(losses[name] for losses in self._recent) / count
            for name in self._recent[-1]
        }

    def _learn(self, samples: list[Sample]) -> dict[str, float]:
        """Does one step and returns the losses before it."""
        config = self._config
        # Networks draw from torch's own generator, as torchvision's do.
        torch.manual_seed(_torch_seed(config.seed, self.step))
        for group in self._optimizer.param_groups:
            group["lr"] = config.rate(self.step)
        images = [sample.image.to(self._device) for sample in samples]
        targets = [
            {k: v.to(self._device) for k, v in sample.target.items()}
            for sample in samples
        ]
        with mixed_precision(self._device, config.bfloat16):
            losses: dict[str, Tensor] = self.network(images, targets)
        total = torch.stack([loss.float() for loss in losses.values()]).sum()
        self._optimizer.zero_grad(set_to_none=True)
        total.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self.network.parameters(), config.max_gradient)
        self._optimizer.step()
        self.average.update(self.network, self.step)
        return {name: loss.item() for name, loss in losses.items()}


@contextmanager
def _samples(
    augmenter: Augmenter, config: TrainingConfig, first: int
) -> Iterator[Iterator[list[Sample]]]:
    """The batches from step `first` on, drawn ahead in another thread."""
    with ThreadPoolExecutor(1) as pool:

        def draw(step: int) -> list[Sample]:
            """The batch of a step."""
            return [
                augmenter.draw(
                    np.random.default_rng([config.seed, 3, step, k]),
                    calm=step >= config.steps * (1 - config.calm),
                )
                for k in range(config.batch)
            ]

        def batches() -> Iterator[list[Sample]]:
            """Asks for each batch a few steps before it gives it."""
            ahead: deque[Future[list[Sample]]] = deque()
            for step in range(first, config.steps + _PREFETCHED):
                if step < config.steps:
                    ahead.append(pool.submit(draw, step))
                if step >= first + _PREFETCHED and ahead:
                    yield ahead.popleft().result()

        try:
            yield batches()
        finally:
            pool.shutdown(cancel_futures=True)


def _torch_seed(seed: int, step: int) -> int:
    return int(np.random.default_rng([seed, 2, step]).integers(2**62))


def _groups(network: nn.Module, decay: float) -> list[dict[str, object]]:
    """Weights that shrink, and those that do not: biases and normalisation."""
    parameters = [p for p in network.parameters() if p.requires_grad]
    return [
        {"params": [p for p in parameters if p.ndim > 1], "weight_decay": decay},
        {"params": [p for p in parameters if p.ndim <= 1], "weight_decay": 0.0},
    ]
