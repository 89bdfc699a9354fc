# SPDX-License-Identifier: MIT
"""The networks by their configuration, and the classes that they tell apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from torch import nn

from physim_drake.detection.networks.config import NetworkConfig, NetworkKind
from physim_drake.detection.networks.faster_rcnn import FasterRcnn
from physim_drake.detection.networks.fcn import FullyConvolutionalNetwork
from physim_drake.objects.model import ObjectModel

Network = FasterRcnn | FullyConvolutionalNetwork


@dataclass(frozen=True)
class ObjectClass:
    """A class that a network tells apart.

    Attributes:
        object_id: id of the object in its library.
        name: name of the object.
    """

    object_id: int
    name: str


def classes_of(library: Mapping[int, ObjectModel]) -> tuple[ObjectClass, ...]:
    """The classes of a library. Label k of a network is the k-th, from 1."""
    return tuple(ObjectClass(i, library[i].name) for i in sorted(library))


def make_network(config: NetworkConfig, classes: int) -> Network:
    """A network with random weights, by torch's random numbers.

    Args:
        config: configuration of the network.
        classes: number of classes, without background.
    """
    kinds: dict[NetworkKind, type[Network]] = {
        NetworkKind.FASTER_RCNN: FasterRcnn,
        NetworkKind.FCN: FullyConvolutionalNetwork,
    }
    network: Network = kinds[config.kind](config, classes)
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    return network


def segmenter(network: Network) -> FullyConvolutionalNetwork:
    """The network that tells the class of every pixel, with weights of another."""
    if isinstance(network, FullyConvolutionalNetwork):
        return network
    config = replace(network.config, kind=NetworkKind.FCN)
    alone = FullyConvolutionalNetwork(config, network.pixels.classes)
    alone.pyramid, alone.pixels = network.pyramid, network.pixels
    return alone.train(network.training)


def count_weights(network: nn.Module) -> int:
    """How many numbers a network learns."""
    return sum(p.numel() for p in network.parameters())
