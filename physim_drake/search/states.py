# SPDX-License-Identifier: MIT
"""States of the search: how they are made, drawn and scored."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from physim_drake.camera import DepthImage
from physim_drake.compiled import compiled
from physim_drake.observation.segmented_scene import SegmentedScene
from physim_drake.physics.settling import SettleConfig
from physim_drake.poses import Array
from physim_drake.registration.trimmed_icp import TrimmedIcpConfig
from physim_drake.rendering.windows import DepthWindow, ObjectRenderer, paste

Placement = Mapping[int, Array]
"""X_SO (4, 4) of the placed objects, by their index in the scene."""


@dataclass(frozen=True)
class ExpansionConfig:
    """Settings of one expansion (Algorithm 2) and of the score.

    Attributes:
        depth_tolerance_m: a pixel is explained if rendered and observed depth differ
            by less, m.
        resegment_distance_m: points nearer than this to a placed object are taken from
            the segment of the next, m.
        min_points: a segment that would keep fewer points is left whole.
        icp: settings of the trimmed ICP.
        icp_points: largest number of points of a segment that are aligned.
        settle: settings of the physics. An object that falls 5 cm is not followed
            farther: of 150 such falls, the image confirmed one.
        settle_loss_fraction: the settled pose is dropped, and the registered one kept,
            if settling loses more than this share of the pixels the object explained:
            what held the object is not placed yet, or not well enough.
    """

    depth_tolerance_m: float = 0.01
    resegment_distance_m: float = 0.008
    min_points: int = 30
    icp: TrimmedIcpConfig = field(default_factory=TrimmedIcpConfig)
    icp_points: int = 400
    settle: SettleConfig = field(
        default_factory=lambda: SettleConfig(lost_distance=0.05)
    )
    settle_loss_fraction: float = 0.1


@dataclass(frozen=True)
class Confirmation:
    """How well the image confirms an object of a state.

    Attributes:
        agrees: share of its visible pixels whose drawn and measured depth agree, 0..1.
        explained: share of its segment's pixels that the state explains, 0..1.
    """

    agrees: float
    explained: float

    @property
    def confidence(self) -> float:
        """The product of both, 0..1; not shared with other poses that fit as well."""
        return self.agrees * self.explained


class StateRenderer:
    """Draws states of a scene and scores them, remembering single objects' windows.

    Args:
        scene: segments and depth that were observed.
        renderer: draws single objects of it.
        epsilon: depths agree if they differ by less, m.
        remembered: number of objects' windows that are kept.
    """

    def __init__(
        self,
        scene: SegmentedScene,
        renderer: ObjectRenderer,
        epsilon: float,
        remembered: int = 48,
    ) -> None:
        self.scene = scene
        self._epsilon = epsilon
        self._renderer = renderer
        self._remembered = remembered
        self._observed = np.ascontiguousarray(scene.observed)
        self._depth = np.ascontiguousarray(scene.depth)
        self._windows: OrderedDict[tuple[int, bytes], DepthWindow] = OrderedDict()

    def object_window(self, index: int, X_SO: Array) -> DepthWindow:
        """Depth window of one object alone."""
        key = (self.scene.object_ids[index], X_SO.tobytes())
        window = self._windows.pop(key, None)
        if window is None:
            window = self._renderer.window(key[0], self.scene.X_CS @ X_SO)
        self._windows[key] = window
        if len(self._windows) > self._remembered:
            self._windows.popitem(last=False)
        return window

    def image(self, placed: Placement) -> DepthImage:
        """Depth image of all placed objects, the nearest winning."""
        result = np.zeros_like(self._observed)
        for index, X_SO in placed.items():
            paste(result, self.object_window(index, X_SO))
        return result

    def labels(self, placed: Placement) -> tuple[DepthImage, NDArray[np.int16]]:
        """Depth image, and the index of the object seen in each pixel (-1: none)."""
        depth = np.zeros_like(self._observed)
        labels = np.full(depth.shape, -1, dtype=np.int16)
        for index, X_SO in placed.items():
            window = self.object_window(index, X_SO)
            behind = window.of(depth)
            nearer = (window.depth > 0) & ((behind == 0) | (window.depth < behind))
            behind[nearer] = window.depth[nearer]
            window.of(labels)[nearer] = index
        return depth, labels

    def score(self, image: DepthImage) -> int:
        """The paper's C: pixels whose rendered and observed depth agree."""
        return int(_agreeing(image, self._observed, self._epsilon))

    def intruding(self, image: DepthImage) -> int:
        """Pixels drawn before what the camera saw there, where nothing can be."""
        return int(_before(image, self._depth, self._epsilon))

    def gain(self, parent: DepthImage, index: int, X_SO: Array) -> int:
        """By how much the score rises when an object is added to an image."""
        window = self.object_window(index, X_SO)
        before = window.of(parent)
        after = composite(before, window.depth)
        observed = window.of(self._observed)
        return int(
            _agreeing(after, observed, self._epsilon)
            - _agreeing(before, observed, self._epsilon)
        )

    def confirmations(self, placed: Placement) -> dict[int, Confirmation]:
        """How well the image confirms each object."""
        depth, labels = self.labels(placed)
        return confirmations(self.scene, depth, labels, placed, self._epsilon)


def confirmations(
    scene: SegmentedScene,
    drawn: DepthImage,
    labels: NDArray[np.int16],
    indices: Iterable[int],
    epsilon: float,
) -> dict[int, Confirmation]:
    """How well an image confirms objects that are drawn over it.

    Args:
        scene: segments and depth that were observed.
        drawn: depth of all objects that are placed, (height, width), m; 0 if none.
        labels: index of the object seen in each pixel, (height, width); -1 if none.
        indices: indices of the objects in the scene.
        epsilon: depths agree if they differ by less, m.

    Returns:
        the confirmation of each object, by its index.
    """
    known = scene.depth > 0
    agrees = (drawn > 0) & (np.abs(drawn - scene.depth) < epsilon)
    return {
        k: Confirmation(
            _share(agrees, (labels == k) & known),
            _share(agrees, scene.segments[k].mask),
        )
        for k in indices
    }


def _share(mask: NDArray[np.bool_], of: NDArray[np.bool_]) -> float:
    """The share of the pixels `of` that lie in `mask`; 0 if there are none."""
    return int(np.count_nonzero(mask & of)) / max(int(np.count_nonzero(of)), 1)


@compiled()
def _agreeing(image: DepthImage, observed: DepthImage, epsilon: float) -> int:
    """How many pixels are drawn and observed at the same depth."""
    count = 0
    for i in range(image.shape[0]):
        for j in range(image.shape[1]):
            drawn, seen = image[i, j], observed[i, j]
            count += (drawn > 0) & (seen > 0) & (abs(drawn - seen) < epsilon)
    return count


@compiled()
def _before(image: DepthImage, depth: DepthImage, epsilon: float) -> int:
    """How many pixels are drawn nearer than what was measured there."""
    count = 0
    for i in range(image.shape[0]):
        for j in range(image.shape[1]):
            count += (image[i, j] > 0) & (image[i, j] < depth[i, j] - epsilon)
    return count


def composite(parent: DepthImage, new: DepthImage) -> DepthImage:
    """The nearer depth of two images, 0 meaning nothing there."""
    nearer = (new > 0) & ((parent == 0) | (new < parent))
    return np.asarray(np.where(nearer, new, parent))
