# SPDX-License-Identifier: MIT
"""The state of a training run, to resume from: safetensors, never a pickle."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import save
from torch import Tensor, nn

from physim_drake.detection.networks.weights import read_safetensors
from physim_drake.detection.training.training_log import check_settings
from physim_drake.errors import InputError
from physim_drake.storage.files import write_atomically

Losses = Sequence[dict[str, float]]
"""By name, one entry a step."""

_REMEDY = "remove it to train from the beginning"


class AveragedWeights:
    """A moving average of a network's weights, which does better than the last ones.

    Args:
        network: network whose weights are averaged, beginning now.
        decay: share that a step keeps, less in the first steps.
    """

    def __init__(self, network: nn.Module, decay: float = 0.998) -> None:
        self._decay = decay
        self.values = {k: v.detach().clone() for k, v in network.state_dict().items()}

    @torch.no_grad()
    def update(self, network: nn.Module, step: int) -> None:
        """Takes in the weights after step `step`, from 0."""
        keep = min(self._decay, (1 + step) / (10 + step))
        for name, value in network.state_dict().items():
            if value.dtype.is_floating_point:
                self.values[name].lerp_(value, 1.0 - keep)
            else:
                self.values[name].copy_(value)


@dataclass(frozen=True)
class TrainingState:
    """What changes while a network learns.

    Attributes:
        network: network in training.
        average: average of its weights.
        optimizer: optimizer of the network.
    """

    network: nn.Module
    average: AveragedWeights
    optimizer: torch.optim.Optimizer

    def save(
        self, path: Path, step: int, settings: dict[str, Any], recent: Losses = ()
    ) -> None:
        """Writes the state after so many steps, whole or not at all.

        Args:
            path: file of the state.
            step: number of steps done.
            settings: settings that a run must share to resume.
            recent: losses that are not in the log yet.

        Raises:
            InputError: if it cannot be written.
        """
        tensors = {f"network.{k}": v for k, v in self.network.state_dict().items()}
        tensors |= {f"average.{k}": v for k, v in self.average.values.items()}
        tensors |= self._optimizer_tensors()
        data = save(
            {k: v.detach().cpu().contiguous() for k, v in tensors.items()},
            {
                "step": str(step),
                "settings": json.dumps(settings),
                "recent": json.dumps(list(recent)),
            },
        )
        with write_atomically(path, "wb") as file:
            file.write(data)

    def load(
        self, path: Path, settings: dict[str, Any]
    ) -> tuple[int, list[dict[str, float]]]:
        """Reads a state, and returns the number of steps done and the recent losses.

        Raises:
            InputError: if it cannot be read, or belongs to a run with other
                settings.
        """
        metadata, tensors = read_safetensors(path, _REMEDY)
        try:
            step = int(metadata["step"])
            earlier = json.loads(metadata["settings"])
            recent = [dict(e) for e in json.loads(metadata.get("recent", "[]"))]
        except (KeyError, ValueError, TypeError, RecursionError):
            problem = "is not the state of a training run"
            raise InputError(path, problem, _REMEDY) from None
        check_settings(path, earlier, settings)
        try:
            self._restore(tensors)
        except (KeyError, RuntimeError) as error:
            raise InputError(
                path, f"does not fit the network ({error})", _REMEDY
            ) from None
        return step, recent

    def _restore(self, tensors: dict[str, Tensor]) -> None:
        self.network.load_state_dict(_part(tensors, "network."))
        for name, value in _part(tensors, "average.").items():
            self.average.values[name].copy_(value)
        for index, parameter in enumerate(self._parameters()):
            values = _part(tensors, f"optimizer.{index}.")
            if values:
                # The counter of steps stays on the CPU, as the optimiser has it.
                self.optimizer.state[parameter] = {
                    k: v.clone()
                    if v.ndim == 0
                    else torch.empty_like(parameter).copy_(v)
                    for k, v in values.items()
                }

    def _optimizer_tensors(self) -> dict[str, Tensor]:
        return {
            f"optimizer.{index}.{name}": value
            for index, parameter in enumerate(self._parameters())
            for name, value in self.optimizer.state[parameter].items()
        }

    def _parameters(self) -> list[nn.Parameter]:
        return [p for group in self.optimizer.param_groups for p in group["params"]]


def _part(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {
        name.removeprefix(prefix): value
        for name, value in tensors.items()
        if name.startswith(prefix)
    }
