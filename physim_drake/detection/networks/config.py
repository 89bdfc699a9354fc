# SPDX-License-Identifier: MIT
"""The configuration of networks, as plain values that are kept beside the weights."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from enum import StrEnum
from typing import Any, get_type_hints


class NetworkKind(StrEnum):
    """The networks."""

    FASTER_RCNN = "faster-rcnn"
    FCN = "fcn"


class BackboneName(StrEnum):
    """What turns an image into features."""

    RESIDUAL = "residual"
    VGG16 = "vgg16"


@dataclass(frozen=True)
class NetworkConfig:
    """A network, its classes aside.

    Attributes:
        kind: kind of network.
        backbone: network that features come from.
        channels: channels of the images, 3, or 4 with depth.
        image_size: longer side, px, to which images are scaled.
        widths: channels of the stages of the residual backbone, at strides 4 to 32.
        depths: residual blocks in each of these stages.
        pyramid_channels: channels of every level of the feature pyramid.
        head_channels: channels of the fully connected layers of the box head.
        mask_layers: convolutions of the mask head before it doubles its resolution.
    """

    kind: NetworkKind = NetworkKind.FASTER_RCNN
    backbone: BackboneName = BackboneName.RESIDUAL
    channels: int = 3
    image_size: int = 448
    widths: tuple[int, ...] = (64, 128, 256, 320)
    depths: tuple[int, ...] = (1, 2, 2, 1)
    pyramid_channels: int = 96
    head_channels: int = 384
    mask_layers: int = 2

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        values = asdict(self)
        return values | {"widths": list(self.widths), "depths": list(self.depths)}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> NetworkConfig:
        """Reads what `as_dict` gives.

        Raises:
            ValueError: if a value is missing, unknown, of a wrong type or out of
                range.
        """
        names = {f.name for f in fields(cls)}
        if set(values) != names:
            odd = ", ".join(sorted(set(values) ^ names))
            raise ValueError(f"missing or unknown: {odd}")
        types = get_type_hints(cls)
        config = cls(**{name: _convert(values[name], types[name]) for name in names})
        if config.channels not in (3, 4):
            raise ValueError(f"channels is {config.channels}, not 3 or 4")
        numbers = [
            config.image_size,
            *config.widths,
            *config.depths,
            config.pyramid_channels,
            config.head_channels,
        ]
        if len(config.widths) != 4 or len(config.depths) != 4:
            raise ValueError("widths and depths must have four members")
        if max(config.depths) > 64:
            raise ValueError("a stage has more than 64 blocks")
        if not all(0 < n <= 4096 for n in numbers) or not 0 <= config.mask_layers < 16:
            raise ValueError("a size is out of range")
        return config


def _convert(value: Any, kind: Any) -> Any:
    if kind is int:
        if type(value) is not int:
            raise ValueError(f"{value!r} is not an integer")
        return value
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        return kind(value)
    if not isinstance(value, list) or any(type(v) is not int for v in value):
        raise ValueError(f"{value!r} is not a list of integers")
    return tuple(value)
