# SPDX-License-Identifier: MIT
"""Weights of networks as safetensors files that describe their network.

Nothing in such a file is ever executed. One that cannot be used is an `InputError`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from physim_drake.detection.networks.config import (
    BackboneName,
    NetworkConfig,
    NetworkKind,
)
from physim_drake.detection.networks.factory import Network, ObjectClass, make_network
from physim_drake.errors import InputError
from physim_drake.storage.files import write_atomically

FORMAT, VERSION = "physim-drake network", "1"

_MAX_CLASSES = 10_000
_REMEDY = "give weights that physim-drake train wrote"
# Of torch.save's zip, of a bare pickle, and of a gzipped one.
_PICKLES = (b"PK\x03\x04", b"\x80", b"\x1f\x8b")


@dataclass(frozen=True)
class Weights:
    """A trained network.

    Attributes:
        network: network with its weights, for use and not for training.
        classes: classes that it tells apart. Label k is the k-th, from 1.
    """

    network: Network
    classes: tuple[ObjectClass, ...]


def save_weights(
    path: Path, weights: Mapping[str, Tensor], config: NetworkConfig, classes: Any
) -> None:
    """Writes weights in half precision.

    Args:
        path: file to write.
        weights: tensors by name, from `state_dict`.
        config: configuration of the network.
        classes: `ObjectClass`, in the order of their labels.

    Raises:
        InputError: if the file cannot be written.
    """
    tensors = {
        name: value.detach().cpu().contiguous().to(torch.float16)
        for name, value in weights.items()
    }
    data = save(tensors, describe(config, classes))
    with write_atomically(path, "wb") as file:
        file.write(data)


def describe(config: NetworkConfig, classes: Sequence[ObjectClass]) -> dict[str, str]:
    """What a file of weights says about them."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "network": json.dumps(config.as_dict()),
        "classes": json.dumps([asdict(c) for c in classes]),
    }


def load_weights(path: Path) -> Weights:
    """Reads what `save_weights` wrote.

    Raises:
        InputError: if the file is missing, cut short, a pickle, of another
            network, or otherwise not as expected.
    """
    metadata, tensors = read_safetensors(path, _REMEDY)
    config, classes = read_description(path, metadata)
    # A few hundred bytes can describe a network of terabytes.
    held, needed = sum(t.numel() for t in tensors.values()), _least_numbers(config)
    if held < needed:
        raise InputError(
            path,
            f"holds {held} numbers, its network has at least {needed}",
            _REMEDY,
            "metadata",
        )
    try:
        network = make_network(config, len(classes))
    except (ValueError, ArithmeticError, RuntimeError) as error:
        raise InputError(
            path, f"describes no network ({error})", _REMEDY, "metadata"
        ) from None
    expected = network.state_dict()
    for name, value in expected.items():
        found = tensors.get(name)
        if found is None or found.shape != value.shape:
            shape = "nothing" if found is None else f"shape {tuple(found.shape)}"
            raise InputError(
                path, f"holds {shape}, not {tuple(value.shape)}", _REMEDY, name
            )
        if not torch.isfinite(found).all():
            raise InputError(path, "holds NaN or infinite values", _REMEDY, name)
    if extra := sorted(set(tensors) - set(expected)):
        raise InputError(path, "belongs to no part of the network", _REMEDY, extra[0])
    network.load_state_dict({name: value.float() for name, value in tensors.items()})
    return Weights(network.eval(), classes)


def _least_numbers(config: NetworkConfig) -> int:
    """Numbers in the largest layers of a network, those of it that every one has."""
    pyramid, hidden = config.pyramid_channels, config.head_channels
    total = 9 * pyramid**2
    if config.backbone is BackboneName.RESIDUAL:
        stages = zip(config.depths, config.widths, strict=True)
        total += sum(9 * depth * width**2 for depth, width in stages)
    if config.kind is NetworkKind.FASTER_RCNN:
        total += hidden**2 + pyramid * hidden + 9 * config.mask_layers * pyramid**2
    return total


def start_from(network: Network, path: Path) -> None:
    """Gives a network the weights of another one, wherever they fit.

    Parts of another shape, or that the other network lacks, stay as they are: with
    another number of objects, those that tell classes apart.

    Args:
        network: network to train.
        path: file that `save_weights` wrote.

    Raises:
        InputError: if the file cannot be read, or not even its features fit.
    """
    own, other = network.state_dict(), load_weights(path).network.state_dict()
    fitting = {k: v for k, v in other.items() if k in own and own[k].shape == v.shape}
    if any(k.startswith("pyramid.") and k not in fitting for k in own):
        raise InputError(
            path,
            "are weights of another backbone",
            "train from the beginning, or with the settings that they were made with",
        )
    network.load_state_dict(own | fitting)


def mix_weights(
    one: Mapping[str, Tensor], other: Mapping[str, Tensor], share: float
) -> dict[str, Tensor]:
    """The weighted mean of a network's weights before and after it was trained on.

    It does about as well as the later ones on what they learnt from, and better on
    images unlike it (Wortsman et al., "Robust fine-tuning of zero-shot models", 2022).

    Args:
        one: weights by name.
        other: weights of the same network by name.
        share: share of `other`, 0..1.
    """
    return {
        name: value.lerp(other[name].to(value), share)
        if value.dtype.is_floating_point
        else value
        for name, value in one.items()
    }


def read_safetensors(path: Path, remedy: str) -> tuple[dict[str, str], dict[str, Any]]:
    """Metadata and tensors of a safetensors file.

    Raises:
        InputError: if it is not a safetensors file.
    """
    head = b""
    try:
        with path.open("rb") as file:
            head = file.read(4)
        with safe_open(path, "pt") as tensors_file:
            metadata = tensors_file.metadata() or {}
            names = tensors_file.keys()
            tensors = {name: tensors_file.get_tensor(name) for name in names}
    except OSError as error:
        raise InputError(
            path, f"cannot be read: {error.strerror or error}", "check the path"
        ) from None
    except (SafetensorError, RuntimeError, ValueError) as error:
        problem = f"is damaged or not a safetensors file ({error})"
        if head.startswith(_PICKLES):
            problem = "is a pickle, and pickles are never loaded"
        raise InputError(path, problem, remedy) from None
    return metadata, tensors


def read_description(
    path: Path, metadata: Mapping[str, str]
) -> tuple[NetworkConfig, tuple[ObjectClass, ...]]:
    """What `describe` says, checked.

    Raises:
        InputError: if the description is of something else.
    """
    if metadata.get("format") != FORMAT:
        raise InputError(path, "holds no network of physim-drake", _REMEDY, "format")
    if metadata.get("version") != VERSION:
        raise InputError(
            path,
            f"is {metadata.get('version')!r}, this program reads {VERSION!r}",
            "use the program that wrote it, or train again",
            "version",
        )
    try:
        config = NetworkConfig.from_dict(json.loads(metadata["network"]))
        classes = _read_classes(json.loads(metadata["classes"]))
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise InputError(
            path, f"cannot be used ({error})", _REMEDY, "metadata"
        ) from None
    return config, classes


def _read_classes(entries: Any) -> tuple[ObjectClass, ...]:
    classes = tuple(ObjectClass(**entry) for entry in entries)
    if not 0 < len(classes) <= _MAX_CLASSES:
        raise ValueError(f"{len(classes)} classes")
    for item in classes:
        if type(item.object_id) is not int or not isinstance(item.name, str):
            raise ValueError(f"{item} is not a class")
    if len({c.object_id for c in classes}) != len(classes):
        raise ValueError("an object has two classes")
    return classes
