# SPDX-License-Identifier: MIT
"""What is drawn over the image that an explanation is about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import matplotlib
import numpy as np
from numpy.typing import NDArray

from physim_drake.observation.observation import Mask
from physim_drake.observation.support_surface import heights_above
from physim_drake.poses import Array, transform_points
from physim_drake.rendering.captions import Captions
from physim_drake.rendering.colors import Color, diverging_colors, object_color
from physim_drake.rendering.depth import DepthRenderer
from physim_drake.rendering.overlay import RESIDUAL_RANGE, draw_overlay, render_labels
from physim_drake.reporting.explanation import Explanation
from physim_drake.scene_estimate import ObjectEstimate

Image = NDArray[np.uint8]

GRID = 0.1
"""Of the lines drawn on the support surface, m."""

CLOSE_UP_HEIGHT = 300
"""Of pictures of a part of the image, px."""

_LEAST_CROP = 90.0  # px of the image
_DIM = 0.35
_UNMEASURED = (40, 40, 40)
_WHITE: Color = (255, 255, 255)
_SURFACE: Color = (0, 170, 160)


class Pictures:
    """Draws the stages of one explanation; images are (height, width, 3) RGB.

    Args:
        explanation: explanation of the image.
        renderer: renderer of its models and its camera.
    """

    def __init__(self, explanation: Explanation, renderer: DepthRenderer) -> None:
        self._e, self._renderer = explanation, renderer

    @cached_property
    def plain(self) -> Image:
        """The colour image, or the depth in grey if there is none."""
        return self._overlay(())

    @cached_property
    def _inside(self) -> Mask:
        """The pixels of all segments; all pixels if there is none."""
        inside = np.any([s.mask for s in self._e.scene.segments], axis=0)
        return np.asarray(inside | (not inside.any()))

    def detections(self) -> Image:
        """The image with the box of each object to find."""
        canvas = self.plain.copy()
        for k, detection in enumerate(self._e.detections):
            if detection.mask is not None:
                _tint(canvas, detection.mask, object_color(k), 0.3)
            left, top, right, bottom = (round(float(x)) for x in detection.box)
            corners = (left, top), (right - 1, bottom - 1)
            cv2.rectangle(canvas, *corners, object_color(k), 2, cv2.LINE_AA)
        captions = Captions(canvas)
        for k, detection in enumerate(self._e.detections):
            left, top = (round(float(x)) for x in detection.box[:2])
            name = self._e.names[k]
            captions.write(name, left, top, object_color(k), centred=False)
        return canvas

    def depth(self) -> Image:
        """The depth image: yellow is near, purple far, black not measured.

        The objects have most of the colours.
        """
        depth = self._e.observation.depth
        near, far = np.percentile(depth[self._inside & (depth > 0)], [1, 99])
        span = max(float(far - near), 0.05)
        share = (far + span / 3 - depth) / (span * 5 / 3)
        return _colored(np.clip(share, 0, 1), depth > 0)

    def surface(self) -> Image:
        """What is taken for the support surface, and a grid that lies on it."""
        canvas = self.plain.copy()
        scene = self._e.scene
        _tint(canvas, (scene.depth > 0) & (scene.observed == 0), _SURFACE, 0.35)
        for start, end in self._grid_lines():
            cv2.line(canvas, start, end, _WHITE, 1, cv2.LINE_AA)
        return canvas

    def heights(self) -> Image:
        """How high everything is above the surface: purple 0, yellow the highest."""
        scene = self._e.scene
        p_C = scene.intrinsics.unproject(scene.depth)
        heights = heights_above(self._e.estimate.surface, p_C)
        top = np.percentile(heights[self._inside], 99)
        return _colored(np.clip(heights / max(float(top), 1e-3), 0, 1), scene.depth > 0)

    def segments(self) -> Image:
        """The pixels of each segment in its object's colour."""
        canvas = (self.plain * 0.6).astype(np.uint8)
        for k, segment in enumerate(self._e.scene.segments):
            _tint(canvas, segment.mask, object_color(k), 0.55)
        return canvas

    def hypotheses(self, k: int) -> Image:
        """Outlines of object `k`'s representatives, the best-scored drawn thick."""
        found = self._e.hypotheses[k]
        view = self._view([k])
        canvas = (view.enlarged(self.plain) * 0.7).astype(np.uint8)
        # The best is drawn last, upon the others.
        for n in reversed(range(len(found.poses))):
            X_CO = self._e.scene.X_CS @ found.poses[n]
            shown = self._renderer.render(found.object_id, X_CO) > 0
            shade = matplotlib.colormaps["viridis"](float(found.scores[n]))
            red, green, blue = (round(255 * c) for c in shade[:3])
            color = _WHITE if n == 0 else (red, green, blue)
            view.outline(canvas, shown, color, 2 if n == 0 else 1)
        return canvas

    def state(self, indices: Sequence[int], X_CO: Array) -> Image:
        """A state of a group of objects over the image, close up.

        Args:
            indices: indices of the objects.
            X_CO: their poses, (N, 4, 4).
        """
        poses = dict(zip(indices, X_CO, strict=True))
        shown = [
            replace(item, X_CO=poses.get(k))
            for k, item in enumerate(self._e.estimate.objects)
        ]
        return self._outlined(shown, self._view(indices))

    def estimate(self) -> Image:
        """The estimate over the image."""
        return self._overlay(self._e.estimate.objects)

    def close_up(self, k: int) -> tuple[Image, Image]:
        """The estimate's outlines and its residuals, close up on object `k`."""
        view = self._view([k])
        left = self._outlined(self._e.estimate.objects, view)
        return left, view.enlarged(self.residuals, cv2.INTER_NEAREST)

    @cached_property
    def residuals(self) -> Image:
        """Drawn minus measured depth where objects are drawn, as `draw_overlay` has it.

        Without the legend, which would cover parts of a close-up.
        """
        measured = self._e.observation.depth
        drawn = render_labels(self._e.estimate.objects, self._renderer).depth
        grey = self.plain.mean(axis=2, keepdims=True) * _DIM
        image = np.repeat(grey, 3, axis=2).astype(np.uint8)
        image[drawn > 0] = _UNMEASURED
        both = (drawn > 0) & (measured > 0)
        share = (drawn[both] - measured[both]) / RESIDUAL_RANGE
        image[both] = diverging_colors(share)
        return image

    def _overlay(self, objects: Sequence[ObjectEstimate]) -> Image:
        shown = replace(self._e.estimate, objects=tuple(objects))
        both = draw_overlay(self._e.observation, shown, self._e.library, self._renderer)
        return both[:, : self._e.observation.intrinsics.width]

    def _outlined(self, objects: Sequence[ObjectEstimate], view: _View) -> Image:
        """What is seen of each object, outlined."""
        canvas = view.enlarged(self.plain)
        labels = render_labels(objects, self._renderer).labels
        for k in range(len(objects)):
            view.outline(canvas, labels == k, object_color(k), 2)
        return canvas

    def _view(self, indices: Sequence[int]) -> _View:
        """The part around the detections of some objects."""
        boxes = np.stack([self._e.detections[k].box for k in indices])
        corners = np.array([boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)])
        half = np.maximum((corners[1] - corners[0]) * 0.65, _LEAST_CROP / 2)
        size = np.array([self.plain.shape[1], self.plain.shape[0]])
        middle = corners.mean(axis=0)
        left, top = np.clip(middle - half, 0, size - 2).astype(int).tolist()
        right, bottom = np.ceil(np.clip(middle + half, 2, size)).astype(int).tolist()
        return _View(left, top, right, bottom)

    def _grid_lines(self) -> list[tuple[tuple[int, int], tuple[int, int]]]:
        """Ends, in pixels, of the lines of a grid on the surface around the objects."""
        segments = [s.points for s in self._e.scene.segments if len(s.points)]
        if not segments:
            return []
        points = np.concatenate(segments)[:, :2]
        low = np.floor(points.min(axis=0) / GRID - 1) * GRID
        high = np.ceil(points.max(axis=0) / GRID + 1) * GRID
        lines = []
        for axis in (0, 1):
            count = round((high[axis] - low[axis]) / GRID)
            for n in range(count + 1):
                ends = np.zeros((2, 3))
                ends[:, axis] = low[axis] + n * GRID
                ends[:, 1 - axis] = low[1 - axis], high[1 - axis]
                p_C = transform_points(self._e.scene.X_CS, ends)
                if (p_C[:, 2] > 0.05).all():
                    (u, v), (s, t) = self._e.scene.intrinsics.project(p_C).tolist()
                    lines.append(((round(u), round(v)), (round(s), round(t))))
        return lines


def _tint(canvas: Image, mask: Mask, color: Color, share: float) -> None:
    canvas[mask] = ((1 - share) * canvas[mask] + share * np.array(color)).astype(
        np.uint8
    )


def _colored(share: NDArray[np.floating], known: Mask) -> Image:
    """Colours of values 0..1, black if they are not known."""
    rgb = (matplotlib.colormaps["viridis"](share)[..., :3] * 255).astype(np.uint8)
    rgb[~known] = 0
    return np.asarray(rgb)


@dataclass(frozen=True)
class _View:
    """A part of the image, drawn larger; in pixels, right and bottom exclusive."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of what is drawn."""
        scale = CLOSE_UP_HEIGHT / (self.bottom - self.top)
        return max(1, round(scale * (self.right - self.left))), CLOSE_UP_HEIGHT

    def enlarged(self, image: Image, way: int = cv2.INTER_CUBIC) -> Image:
        """This part of an image."""
        part = image[self.top : self.bottom, self.left : self.right]
        return np.asarray(cv2.resize(part, self.size, interpolation=way), np.uint8)

    def outline(self, canvas: Image, mask: Mask, color: Color, width: int) -> None:
        """Draws the edge of a mask of the whole image into this part, enlarged."""
        part = mask[self.top : self.bottom, self.left : self.right].astype(np.float32)
        smooth = cv2.resize(part, self.size, interpolation=cv2.INTER_LINEAR) > 0.5
        edges, _ = cv2.findContours(
            smooth.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE
        )
        cv2.drawContours(canvas, edges, -1, color, width, cv2.LINE_AA)
