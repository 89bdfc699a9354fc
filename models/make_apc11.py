# SPDX-License-Identifier: MIT
"""Makes the folder of the eleven objects: ``python -m physim_drake.models.make_apc11``.

For each object it writes an OBJ with normals and texture coordinates, its MTL and PNG,
an OBJ for each convex collision piece, and an SDF file. For all of them it writes
``library.yaml``. Each run writes the same files.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Collection, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image

from physim_drake.models import APC11
from physim_drake.models.apc11_drawing import Atlas
from physim_drake.models.apc11_objects import FRICTION, ObjectSpec, all_objects
from physim_drake.models.apc11_shapes import (
    Array,
    Indices,
    Surface,
    convex_faces,
    corner_normals,
)
from physim_drake.objects.library_files import LIBRARY_FILE
from physim_drake.objects.model import ObjectLibrary, ObjectModel
from physim_drake.objects.sdformat import write_drake_model
from physim_drake.poses import make_pose

_MATERIAL = """\
newmtl {name}
Ka 1 1 1
Kd 1 1 1
Ks 0.05 0.05 0.05
Ns 10
map_Kd {name}.png
"""


def make_models(folder: Path, names: Collection[str] = ()) -> None:
    """Writes the objects into `folder`.

    Args:
        folder: folder for the files, made if it does not exist.
        names: names of the objects to write. If empty, all are written.
    """
    specs = [s for s in all_objects() if not names or s.name in names]
    for spec in specs:
        _write_object(spec, folder / spec.name)
    text = "objects:\n" + "".join(_library_entry(spec) for spec in specs)
    (folder / LIBRARY_FILE).write_text(text, encoding="utf-8")
    for model in ObjectLibrary.load(folder).values():
        _write_sdf(model, folder / model.name)


def _write_object(spec: ObjectSpec, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    atlas = Atlas.packed(spec.surface.panels)
    panels = atlas.blank_panels()
    spec.paint(panels)
    image = atlas.texture(panels).quantize(128, dither=Image.Dither.NONE)
    image.save(folder / f"{spec.name}.png", optimize=True)
    material = _MATERIAL.format(name=spec.name)
    (folder / f"{spec.name}.mtl").write_text(material, encoding="utf-8")
    text = _visual_obj(spec.name, spec.surface, atlas)
    (folder / f"{spec.name}.obj").write_text(text, encoding="utf-8")
    for index, corners in enumerate(spec.pieces):
        path = folder / _piece_name(spec, index)
        path.write_text(_piece_obj(corners), encoding="utf-8")


def _write_sdf(model: ObjectModel, folder: Path) -> None:
    """Adds the SDF file, which names the meshes that are already in the folder."""
    with TemporaryDirectory() as scratch:
        shutil.copy(write_drake_model(model, Path(scratch)), folder)


def _visual_obj(name: str, surface: Surface, atlas: Atlas) -> str:
    """The text of an OBJ file whose vertices are shared across texture seams."""
    uv = np.empty_like(surface.uv)
    for index, panel in enumerate(surface.panels):
        on_panel = surface.panel == index
        uv[on_panel] = atlas.coordinates(panel, surface.uv[on_panel])
    places, uv_index = _distinct(uv, 6)
    normals, normal_index = _distinct(corner_normals(surface), 4)
    corners = np.stack([surface.faces, uv_index, normal_index], axis=-1) + 1
    lines = [f"mtllib {name}.mtl", f"usemtl {name}"]
    lines += _rows("v", surface.vertices, 6)
    lines += _rows("vt", places, 6)
    lines += _rows("vn", normals, 4)
    lines += [
        "f " + " ".join("/".join(str(i) for i in corner) for corner in face)
        for face in corners.tolist()
    ]
    return "\n".join(lines) + "\n"


def _piece_obj(corners: Array) -> str:
    faces = convex_faces(corners) + 1
    lines = _rows("v", corners, 6)
    lines += ["f " + " ".join(str(i) for i in face) for face in faces.tolist()]
    return "\n".join(lines) + "\n"


def _rows(keyword: str, values: Array, digits: int) -> list[str]:
    rounded = values.round(digits) + 0.0  # no negative zeros
    return [
        f"{keyword} " + " ".join(f"{x:.{digits}f}" for x in row)
        for row in rounded.tolist()
    ]


def _distinct(values: Array, digits: int) -> tuple[Array, Indices]:
    """Distinct rows of (F, 3, D) values, and the row of each corner (F, 3)."""
    flat = values.reshape(-1, values.shape[-1]).round(digits) + 0.0
    rows, index = np.unique(flat, axis=0, return_inverse=True)
    return rows, np.reshape(index, values.shape[:2])


def _library_entry(spec: ObjectSpec) -> str:
    """The object's lines in the library file, one key on each."""
    turns = [(make_pose(R) + 0.0).ravel().tolist() for R in spec.turns]
    axes = [{"axis": list(a), "point": [0, 0, 0]} for a in spec.axes]
    pieces = [_piece_name(spec, k) for k in range(len(spec.pieces))]
    entry = {
        "id": spec.object_id,
        "name": spec.name,
        "mesh": f"{spec.name}/{spec.name}.obj",
        "collision": [f"{spec.name}/{piece}" for piece in pieces],
        "mass": spec.mass,
        "friction": FRICTION,
        "symmetry": {"discrete": turns, "continuous": axes},
    }
    lines = [f"{key}: {json.dumps(value)}\n" for key, value in entry.items()]
    return "- " + "  ".join(lines)


def _piece_name(spec: ObjectSpec, index: int) -> str:
    return f"{spec.name}_collision_{index}.obj"


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the program."""
    parser = argparse.ArgumentParser(description="Make the eleven objects' models.")
    parser.add_argument("--out", type=Path, default=APC11, help="folder to write to")
    make_models(parser.parse_args(arguments).out)


if __name__ == "__main__":
    main()
