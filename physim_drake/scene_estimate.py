# SPDX-License-Identifier: MIT
"""The result of an estimation: the pose of every object, and its confidence."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.math import RollPitchYaw, RotationMatrix

from physim_drake.notebook import table_html
from physim_drake.objects.model import ObjectLibrary
from physim_drake.objects.model_directives import (
    Directive,
    Tagged,
    add_frame,
    add_model,
    add_weld,
    directives_text,
)
from physim_drake.objects.sdformat import file_stem, write_drake_model
from physim_drake.observation.observation import Detection
from physim_drake.observation.support_surface import SupportSurface
from physim_drake.poses import Array
from physim_drake.storage.files import write_atomically


@dataclass(frozen=True)
class ObjectEstimate:
    """One object's pose, if it was found.

    Attributes:
        object_id: id of the object.
        name: name of the object.
        X_CO: pose in the camera, (4, 4), or None.
        X_WO: pose in the world, (4, 4), or None. Without a camera pose the world is the
            support frame.
        confidence: confidence, 0..1: the share of its visible pixels whose rendered and
            measured depth agree within 1 cm, times the share of its segment that the
            estimated scene explains. It is divided among its poses if others explain
            the image about as well, and 0 if the object was not found.
        reason: reason why it was not found, else empty.
    """

    object_id: int
    name: str
    X_CO: Array | None
    X_WO: Array | None
    confidence: float
    reason: str

    @property
    def found(self) -> bool:
        """Whether there is a pose."""
        return self.X_CO is not None


@dataclass(frozen=True)
class SearchTrace:
    """The anytime curve of one group's search, with poses in the camera.

    Attributes:
        indices: indices of the group's objects in the estimate, in placing order.
        points: (expansion, seconds, best score in pixels, X_CO (N, 4, 4)), one each
            time the best score rose.
        expansions: number of expansions in all.
    """

    indices: tuple[int, ...]
    points: tuple[tuple[int, float, int, Array], ...]
    expansions: int

    def as_dict(self) -> dict[str, Any]:
        """Plain lists and numbers, for JSON; poses row-wise, m."""
        return {
            "objects": list(self.indices),
            "expansions": self.expansions,
            "points": [
                {
                    "expansion": expansion,
                    "seconds": seconds,
                    "score": score,
                    "X_CO": np.asarray(poses).tolist(),
                }
                for expansion, seconds, score, poses in self.points
            ],
        }


@dataclass(frozen=True)
class SceneEstimate:
    """The estimated scene.

    Attributes:
        objects: one estimate for each detection, in their order.
        surface: surface that the objects rest on.
        method: method that made the estimate.
        stages: seconds by stage.
        trace: anytime curve of each independent group that was searched.
        detections: detection by which each object was looked for: the given one, or,
            if it has alternatives, the one that explains more of the image.
        warning: fault that the whole input seems to have, else empty. The reasons of
            objects that were not found end with it.
    """

    objects: tuple[ObjectEstimate, ...]
    surface: SupportSurface
    method: str
    stages: Mapping[str, float]
    trace: tuple[SearchTrace, ...] = ()
    detections: tuple[Detection, ...] = ()
    warning: str = ""

    @property
    def found(self) -> tuple[ObjectEstimate, ...]:
        """The objects that have a pose."""
        return tuple(item for item in self.objects if item.found)

    @property
    def seconds(self) -> float:
        """Time of all stages together, s."""
        return sum(self.stages.values())

    def reason_alone(self, item: ObjectEstimate) -> str:
        """Why an object was not found, without the warning about the whole input."""
        return item.reason.removesuffix(f"; {self.warning}")

    def __str__(self) -> str:
        lines = [f"{self.method}, {self.seconds:.1f} s"]
        if self.warning:
            lines.append(f"  warning: {self.warning}")
        for o in self.objects:
            if o.X_WO is None:
                lines.append(f"  {o.name}: not found ({self.reason_alone(o)})")
                continue
            xyz, rpy, confidence = self._cells(o)
            lines.append(
                f"  {o.name}: xyz {xyz} m, rpy {rpy} deg, confidence {confidence}"
            )
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        heads = ("object", "xyz, m", "rpy, deg", "confidence")
        rows = [(o.name, *self._cells(o)) for o in self.objects]
        warning = f"<p>warning: {escape(self.warning)}</p>" if self.warning else ""
        return warning + table_html(heads, rows)

    def _cells(self, item: ObjectEstimate) -> tuple[str, str, str]:
        """Position, orientation and confidence in print, or why it was not found."""
        if item.X_WO is None:
            return f"not found ({self.reason_alone(item)})", "", ""
        rpy = RollPitchYaw(RotationMatrix(item.X_WO[:3, :3])).vector()
        return (
            str(np.round(item.X_WO[:3, 3], 4).tolist()),
            str(np.round(np.degrees(rpy), 1).tolist()),
            f"{item.confidence:.2f}",
        )

    def to_model_directives(self, library: ObjectLibrary, folder: str | Path) -> Path:
        """Writes the found objects as Drake model directives, each welded in place.

        Args:
            library: models of the objects.
            folder: folder for `scene.dmd.yaml` and the models' SDFs, made if missing.

        Returns:
            the directives' file. Its paths hold as long as the folder is not moved.

        Raises:
            InputError: if the folder cannot be written.
        """
        folder = Path(folder)
        directives: list[Directive] = []
        counts: Counter[str] = Counter()
        stems = _file_stems(self.objects)
        for estimate in self.objects:
            if estimate.X_WO is None:
                continue
            stem = stems[estimate.object_id]
            sdf = write_drake_model(library[estimate.object_id], folder / stem)
            counts[stem] += 1
            name = stem if counts[stem] == 1 else f"{stem}_{counts[stem]}"
            rpy = RollPitchYaw(RotationMatrix(estimate.X_WO[:3, :3])).vector()
            directives += _welded_model(
                name, sdf, estimate.X_WO[:3, 3].tolist(), np.degrees(rpy).tolist()
            )
        path = folder / "scene.dmd.yaml"
        with write_atomically(path) as file:
            file.write(directives_text(directives))
        return path


def _file_stems(objects: Sequence[ObjectEstimate]) -> dict[int, str]:
    """A folder's name for each object by its id, no two the same."""
    stems: dict[int, str] = {}
    for item in objects:
        if item.object_id not in stems:
            stem = file_stem(item.name)
            taken = stem in stems.values()
            stems[item.object_id] = f"{stem}_id{item.object_id}" if taken else stem
    return stems


def _welded_model(
    name: str, sdf: Path, translation: list[float], rpy_deg: list[float]
) -> list[Directive]:
    frame = f"{name}_estimate"
    rotation = Tagged("!Rpy", {"deg": rpy_deg})
    return [
        add_model(name, f"file://{sdf.resolve()}"),
        add_frame(frame, {"translation": translation, "rotation": rotation}),
        add_weld(frame, f"{name}::body"),
    ]
