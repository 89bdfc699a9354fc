# SPDX-License-Identifier: MIT
"""Writes object models as SDFormat for Drake's parser."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any, cast

import numpy as np
import trimesh

from physim_drake.objects.meshes import posed_raw_mesh
from physim_drake.objects.model import ObjectModel
from physim_drake.poses import Array
from physim_drake.storage.files import cannot_write

HYDROELASTIC_MODULUS = 1e7  # Pa, Drake's default
DISSIPATION = 50.0  # s/m, Hunt and Crossley's, Drake's default
_GREY = np.array([0.7, 0.7, 0.7])


def file_stem(name: str) -> str:
    """A name that suits a file and stays in its folder, whatever `name` is."""
    return re.sub(r"[^\w.-]", "_", name)[:100].lstrip(".") or "object"


def write_drake_model(model: ObjectModel, folder: Path) -> Path:
    """Writes a model with its meshes into a folder.

    The model has one link, `body`, whose frame is O; an OBJ with normals to look at,
    textured if the source is, and convex compliant hydroelastic pieces to touch.

    Args:
        model: the object.
        folder: is made if it does not exist; files of the same names are replaced.

    Returns:
        the SDF file, `<folder>/<name>.sdf`; characters that do not suit a file's name
        become underscores.

    Raises:
        InputError: if the folder cannot be written.
    """
    try:
        return _write_files(model, folder)
    except OSError as error:
        raise cannot_write(folder, error) from error


def _write_files(model: ObjectModel, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    stem = file_stem(model.name)
    visual = _write_visual(model, folder, stem)
    pieces = []
    for i, piece in enumerate(model.collision_pieces):
        path = folder / f"{stem}_collision_{i}.obj"
        path.write_text(_obj_text(piece.vertices, piece.faces), encoding="utf-8")
        pieces.append(path.name)
    sdf = ET.Element("sdf", version="1.9", attrib={"xmlns:drake": "drake.mit.edu"})
    link = ET.SubElement(ET.SubElement(sdf, "model", name=stem), "link")
    link.set("name", "body")
    _add_inertial(link, model)
    _add_mesh(ET.SubElement(link, "visual", name="visual"), visual.name)
    for i, name in enumerate(pieces):
        collision = ET.SubElement(link, "collision", name=f"collision_{i}")
        mesh = _add_mesh(collision, name)
        ET.SubElement(mesh, "drake:declare_convex")
        _add_contact(collision, model.friction)
    ET.indent(sdf)
    path = folder / f"{stem}.sdf"
    path.write_text(ET.tostring(sdf, encoding="unicode") + "\n", encoding="utf-8")
    return path


def _add_inertial(link: ET.Element, model: ObjectModel) -> None:
    inertial = ET.SubElement(link, "inertial")
    x, y, z = model.center_of_mass
    ET.SubElement(inertial, "pose").text = f"{x:.9g} {y:.9g} {z:.9g} 0 0 0"
    ET.SubElement(inertial, "mass").text = f"{model.mass:.9g}"
    inertia = ET.SubElement(inertial, "inertia")
    for i, j in zip(*np.triu_indices(3), strict=True):
        tag = "i" + "xyz"[i] + "xyz"[j]
        ET.SubElement(inertia, tag).text = f"{model.inertia[i, j]:.9g}"


def _add_mesh(parent: ET.Element, uri: str) -> ET.Element:
    mesh = ET.SubElement(ET.SubElement(parent, "geometry"), "mesh")
    ET.SubElement(mesh, "uri").text = uri
    return mesh


def _add_contact(collision: ET.Element, friction: float) -> None:
    properties = ET.SubElement(collision, "drake:proximity_properties")
    ET.SubElement(properties, "drake:compliant_hydroelastic")
    for name, value in (
        ("hydroelastic_modulus", HYDROELASTIC_MODULUS),
        ("hunt_crossley_dissipation", DISSIPATION),
        ("mu_static", friction),
        ("mu_dynamic", friction),
    ):
        ET.SubElement(properties, f"drake:{name}").text = f"{value:.9g}"


def _write_visual(model: ObjectModel, folder: Path, stem: str) -> Path:
    """Writes the visual OBJ with its material; returns its path."""
    path, material = folder / f"{stem}.obj", folder / f"{stem}.mtl"
    raw = None
    if model.source.is_file():
        raw = posed_raw_mesh(model.source, model.source_unit, model.source_pose)
    color, image, uv = _GREY, None, None
    # Which of trimesh's kinds of visuals it is, its `kind` says.
    visual = cast(Any, getattr(raw, "visual", None))
    if raw is not None and visual.kind == "texture":
        image, uv = _texture_image(raw), visual.uv
    elif raw is not None and visual.kind == "vertex":
        color = np.asarray(visual.vertex_colors)[:, :3].mean(axis=0) / 255
    lines = ["newmtl surface", "Kd {:.4f} {:.4f} {:.4f}".format(*color)]
    if raw is not None and image is not None and uv is not None:
        # The merged mesh of the model has lost the seams of the texture.
        text = _obj_text(
            np.asarray(raw.vertices) * model.source_unit,
            np.asarray(raw.faces),
            np.asarray(raw.vertex_normals),
            np.asarray(uv),
        )
        image.save(folder / f"{stem}.png")
        lines[1:] = ["Kd 1 1 1", f"map_Kd {stem}.png"]
    else:
        mesh = model.mesh
        text = _obj_text(mesh.vertices, mesh.faces, mesh.vertex_normals)
    material.write_text("\n".join(lines) + "\n", encoding="utf-8")
    header = f"mtllib {material.name}\nusemtl surface\n"
    path.write_text(header + text, encoding="utf-8")
    return path


def _texture_image(raw: trimesh.Trimesh) -> Any:
    """The image of a mesh's material, packed from several if there are.

    None if there is none, or it is damaged.
    """
    material = getattr(raw.visual, "material", None)
    image = getattr(material, "image", None)
    if image is None:
        image = getattr(material, "baseColorTexture", None)
    try:
        return None if image is None else image.convert("RGB")
    except Exception:  # Pillow raises whatever its parsers come upon
        return None


def _obj_text(
    vertices: Array,
    faces: Array,
    normals: Array | None = None,
    uv: Array | None = None,
) -> str:
    """An OBJ file's text: (V, 3) vertices, (F, 3) faces, (V, 3) normals, (V, 2) uv."""
    lines = ["v {:.7g} {:.7g} {:.7g}".format(*v) for v in vertices]
    if uv is not None:
        lines += ["vt {:.6g} {:.6g}".format(*t) for t in uv]
    if normals is not None:
        lines += ["vn {:.5g} {:.5g} {:.5g}".format(*n) for n in normals]
    corner = {
        (False, False): "{0}",
        (True, False): "{0}/{0}",
        (False, True): "{0}//{0}",
        (True, True): "{0}/{0}/{0}",
    }[uv is not None, normals is not None]
    pattern = f"f {corner} {corner.replace('0', '1')} {corner.replace('0', '2')}"
    lines += [pattern.format(*face) for face in np.asarray(faces) + 1]
    return "\n".join(lines) + "\n"
