# SPDX-License-Identifier: MIT
"""What a detector is: anything that says which objects are where in an image."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from physim_drake.observation.observation import Detection, RgbdObservation

LabelImage = NDArray[np.int16]
"""(height, width), what the renderer calls that which each pixel shows."""


class DetectionAlgorithm(Protocol):
    """Finds objects in images; any object with this method is one."""

    def detect(
        self,
        observation: RgbdObservation,
        labels: LabelImage | None,
        generator: np.random.Generator,
    ) -> tuple[Detection, ...]:
        """Finds the objects in an image.

        Args:
            observation: the image.
            labels: what each pixel shows according to the renderer, for algorithms that
                stand in for a detector; None if that is not known.
            generator: source of all random choices; the same for the same look.

        Raises:
            InputError: if the image cannot be used.
        """
        ...
