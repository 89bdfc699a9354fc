# SPDX-License-Identifier: MIT
"""How large the objects of an image are; the lengths of every step follow it.

The lengths of the pipeline (voxels, tolerances, gates) are made for objects of 5 to
30 cm. A scene of smaller or larger objects is seen through a lens: it is estimated at a
scale at which they have such a size, a power of two, so that nothing is rounded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from physim_drake.objects.model import ObjectModel
from physim_drake.observation.observation import Detection, RgbdObservation

_SMALLEST = 0.04  # m; of diameters for which the pipeline's lengths are made
_LARGEST = 0.45


@dataclass(frozen=True)
class ObjectSizes:
    """Sizes of the objects to find, by their ids; none are known by default.

    Attributes:
        diameters: m.
        thicknesses: least extents, m.
    """

    diameters: Mapping[int, float] = field(default_factory=dict)
    thicknesses: Mapping[int, float] = field(default_factory=dict)

    @classmethod
    def of(
        cls, detections: Sequence[Detection], library: Mapping[int, ObjectModel]
    ) -> ObjectSizes:
        """The sizes of the objects that were detected and have models."""
        ids = sorted({d.object_id for d in detections} & set(library))
        return cls(
            {i: library[i].diameter for i in ids},
            {i: float(library[i].extents.min()) for i in ids},
        )

    @property
    def factor(self) -> float:
        """By what the pipeline's lengths are multiplied, a power of two.

        It is 1 for objects of 4 to 45 cm. If both smaller and larger ones are there,
        the smaller ones decide.
        """
        factor = 1.0
        if not self.diameters:
            return factor
        least, most = min(self.diameters.values()), max(self.diameters.values())
        while least / factor < _SMALLEST and least > 0:
            factor /= 2
        while most / factor > _LARGEST and least / (2 * factor) >= _SMALLEST:
            factor *= 2
        return factor

    def distance(
        self, observation: RgbdObservation, detections: Sequence[Detection]
    ) -> float:
        """How far away the objects are, m, if the depth image and their sizes agree.

        The lesser of the measured distance and twice the one at which they fill their
        boxes, so that a depth image of a wrong unit does not pass for a large scene.
        """
        K = observation.intrinsics
        distances = []
        for d in detections:
            measured = observation.depth[d.pixels(*observation.depth.shape)]
            measured = measured[measured > 0]
            if len(measured) and d.object_id in self.diameters:
                left, top, right, bottom = d.box
                diagonal = np.hypot((right - left) / K.fx, (bottom - top) / K.fy)
                filled = self.diameters[d.object_id] / max(float(diagonal), 1e-9)
                distances.append(min(float(np.median(measured)), 2 * filled))
        return max(distances, default=0.0)


UNKNOWN_SIZES = ObjectSizes()
"""Of objects without models: lengths are those for objects of 5 to 30 cm."""
