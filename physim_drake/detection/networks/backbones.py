# SPDX-License-Identifier: MIT
"""From an image to a pyramid of features, in plain torch.

Two backbones: a small residual network (He et al., CVPR 2016) and VGG16 (Simonyan and
Zisserman, ICLR 2015), which the paper used. Both normalise by groups of channels (Wu
and He, ECCV 2018), not over the batch, so that they train from scratch in small
batches. The feature pyramid is that of Lin et al., CVPR 2017.
"""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor, nn
from torch.nn import functional

from physim_drake.detection.networks.config import BackboneName, NetworkConfig

STRIDES = (4, 8, 16, 32)
"""Pixels a cell of the levels of the pyramid."""

_GROUP = 8  # channels, at least
_STEM = 32
_VGG_STAGES = ((64, 2), (128, 2), (256, 3), (512, 3), (512, 3))


class FeaturePyramid(nn.Module):
    """A backbone, and on it maps of equal depth at strides 4, 8, 16 and 32.

    Args:
        config: configuration of the network.

    Attributes:
        channels: channels of each map.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.backbone: ResidualBackbone | VggBackbone
        if config.backbone is BackboneName.VGG16:
            self.backbone = VggBackbone(config.channels)
        else:
            self.backbone = ResidualBackbone(
                config.channels, config.widths, config.depths
            )
        self.channels = config.pyramid_channels
        self.lateral = nn.ModuleList(
            nn.Conv2d(width, self.channels, 1) for width in self.backbone.widths
        )
        self.smooth = nn.ModuleList(
            nn.Conv2d(self.channels, self.channels, 3, padding=1)
            for _ in self.backbone.widths
        )

    def forward(self, images: Tensor) -> list[Tensor]:
        """Maps (B, channels, height / stride, width / stride), finest first.

        Args:
            images: (B, C, height, width), both sides multiples of 32.
        """
        stages = self.backbone(images)
        maps: list[Tensor] = []
        coarser: Tensor | None = None
        for k in reversed(range(len(stages))):
            merged = self.lateral[k](stages[k])
            if coarser is not None:
                merged = merged + functional.interpolate(coarser, scale_factor=2.0)
            coarser = merged
            maps.insert(0, self.smooth[k](merged))
        return maps


class ResidualBackbone(nn.Module):
    """A residual network of basic blocks.

    Args:
        channels: channels of the images.
        widths: channels of each stage. The first has stride 4.
        depths: blocks of each stage.
    """

    def __init__(
        self, channels: int, widths: Sequence[int], depths: Sequence[int]
    ) -> None:
        super().__init__()
        self.widths = tuple(widths)
        self.stem = nn.Sequential(
            nn.Conv2d(channels, _STEM, 5, stride=2, padding=2, bias=False),
            _norm(_STEM),
            nn.ReLU(inplace=True),
        )
        stages, width = [], _STEM
        for out, depth in zip(widths, depths, strict=True):
            blocks = [_Block(width, out, stride=2)]
            blocks += [_Block(out, out, stride=1) for _ in range(depth - 1)]
            stages.append(nn.Sequential(*blocks))
            width = out
        self.stages = nn.ModuleList(stages)
        _initialise(self)
        for block in self.modules():
            if isinstance(block, _Block):  # begins as the identity
                nn.init.zeros_(block.norm2.weight)

    def forward(self, images: Tensor) -> list[Tensor]:
        """The output of each stage."""
        maps = []
        x = self.stem(images)
        for stage in self.stages:
            x = stage(x)
            maps.append(x)
        return maps


class VggBackbone(nn.Module):
    """The 13 convolutions of VGG16, with normalisation.

    Args:
        channels: channels of the images.
    """

    widths = (256, 512, 512, 512)

    def __init__(self, channels: int) -> None:
        super().__init__()
        stages, width = [], channels
        for out, depth in _VGG_STAGES:
            layers: list[nn.Module] = []
            for _ in range(depth):
                layers += [
                    nn.Conv2d(width, out, 3, padding=1, bias=False),
                    _norm(out),
                    nn.ReLU(inplace=True),
                ]
                width = out
            stages.append(nn.Sequential(*layers))
        self.stages = nn.ModuleList(stages)
        _initialise(self)

    def forward(self, images: Tensor) -> list[Tensor]:
        """The third to fifth stage, and the last pooling."""
        maps = []
        x = images
        for stage in self.stages:
            x = stage(x)
            maps.append(x)
            x = functional.max_pool2d(x, 2)
        return [*maps[2:], x]


class _Block(nn.Module):
    """Two convolutions beside a shortcut."""

    def __init__(self, width: int, out: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(width, out, 3, stride, padding=1, bias=False)
        self.norm1 = _norm(out)
        self.conv2 = nn.Conv2d(out, out, 3, padding=1, bias=False)
        self.norm2 = _norm(out)
        self.shortcut: nn.Module = nn.Identity()
        if stride != 1 or width != out:
            self.shortcut = nn.Sequential(
                nn.AvgPool2d(stride),
                nn.Conv2d(width, out, 1, bias=False),
                _norm(out),
            )

    def forward(self, x: Tensor) -> Tensor:
        y = functional.relu(self.norm1(self.conv1(x)), inplace=True)
        y = self.norm2(self.conv2(y)) + self.shortcut(x)
        return functional.relu(y, inplace=True)


def _norm(channels: int) -> nn.GroupNorm:
    return nn.GroupNorm(min(32, channels // _GROUP), channels)


def _initialise(module: nn.Module) -> None:
    for layer in module.modules():
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight, mode="fan_out", nonlinearity="relu")
