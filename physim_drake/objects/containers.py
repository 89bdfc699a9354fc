# SPDX-License-Identifier: MIT
"""What scenes stand on or in: a table, a tote, a shelf bay.

Each is a static model of boxes (`models/<name>/<name>.sdf`) whose frame is the world
frame of a scene: origin in the middle of the surface, z along its normal.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import physim_drake.models
from physim_drake.objects.container_name import ContainerName as ContainerName
from physim_drake.poses import Array


@dataclass(frozen=True)
class ContainerBox:
    """A box of a container, its axes those of W.

    Attributes:
        name: of the visual.
        center: p_WB, (3,), m.
        size: (3,), m.
    """

    name: str
    center: Array
    size: Array


@dataclass(frozen=True)
class Container:
    """A static model, where objects may lie in it, and from where it is looked at.

    Attributes:
        name: its name, and that of its model.
        sdf: its model.
        boxes: its surface.
        half_extents: of the area for objects, along x and y about the origin, (2,), m.
        height: free height above the area, m.
        azimuth: range of the camera's bearing, rad, about z from x.
        elevation: range of its angle above the surface, rad.
    """

    name: str
    sdf: Path
    boxes: tuple[ContainerBox, ...]
    half_extents: Array
    height: float
    azimuth: tuple[float, float]
    elevation: tuple[float, float]

    @property
    def largest_object(self) -> float:
        """Diameter of the largest object that fits in every orientation, m."""
        return float(min(2 * self.half_extents.min(), self.height))


# Half extents of the area (m), free height (m), azimuth and elevation (deg).
_USE = {
    ContainerName.TABLE: ((0.35, 0.35), 1.0, (-180.0, 180.0), (35.0, 75.0)),
    ContainerName.TOTE: ((0.28, 0.21), 1.0, (-180.0, 180.0), (50.0, 78.0)),
    ContainerName.SHELF: ((0.28, 0.20), 0.36, (-115.0, -65.0), (12.0, 30.0)),
}


@cache
def load_container(name: ContainerName) -> Container:
    """Reads a container that comes with the package."""
    sdf = Path(physim_drake.models.__file__).parent / name / f"{name}.sdf"
    boxes = []
    for visual in ET.parse(sdf).iter("visual"):
        pose = [float(x) for x in visual.findtext("pose", "").split()]
        size = visual.findtext("geometry/box/size", "").split()
        part, center = visual.get("name", ""), np.array(pose[:3])
        boxes.append(ContainerBox(part, center, np.array(size, dtype=float)))
    half_extents, height, azimuth, elevation = _USE[name]
    return Container(
        str(name),
        sdf,
        tuple(boxes),
        np.array(half_extents),
        height,
        (np.deg2rad(azimuth[0]), np.deg2rad(azimuth[1])),
        (np.deg2rad(elevation[0]), np.deg2rad(elevation[1])),
    )
