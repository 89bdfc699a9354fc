# SPDX-License-Identifier: MIT
"""An estimate that knows its image, and so can draw itself."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physim_drake.notebook import image_html
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.observation import RgbdObservation
from physim_drake.rendering.overlay import draw_overlay, write_png
from physim_drake.scene_estimate import SceneEstimate


@dataclass(frozen=True, kw_only=True)
class ImageEstimate(SceneEstimate):
    """The estimated scene, with the image and the models that it was made of.

    Attributes:
        observation: image that the poses explain.
        library: models of the objects.
    """

    observation: RgbdObservation
    library: ObjectLibrary

    @classmethod
    def of(
        cls,
        estimate: SceneEstimate,
        observation: RgbdObservation,
        library: ObjectLibrary,
    ) -> ImageEstimate:
        """Adds the image and the models to an estimate."""
        values = {f.name: getattr(estimate, f.name) for f in fields(SceneEstimate)}
        return cls(**values, observation=observation, library=library)

    def draw(self, path: str | Path | None = None) -> NDArray[np.uint8]:
        """Draws the poses over the image; see `draw_overlay`.

        Args:
            path: PNG file to write the picture to, if it is given.

        Returns:
            RGB image, (height, 2 width, 3).

        Raises:
            InputError: if the file cannot be written.
        """
        image = draw_overlay(self.observation, self, self.library)
        if path is not None:
            write_png(path, image)
        return image

    def __repr__(self) -> str:
        return f"<{self}>"

    def _repr_html_(self) -> str:
        described = f"estimated objects in {self.observation.name}"
        return super()._repr_html_() + image_html(self.draw(), described)
