# SPDX-License-Identifier: MIT
"""Objects that SDFormat or URDF files describe.

Object frame O is the frame of the link. The mesh of its visual may be posed and scaled
in it. Mass and inertia are those of the link, if it has any.
"""

from __future__ import annotations

import logging
import xml.etree.ElementTree as ET
from pathlib import Path, PurePosixPath

import numpy as np
from scipy.spatial.transform import Rotation

from physim_drake.errors import InputError
from physim_drake.objects.object_entry import GivenInertia, ObjectEntry
from physim_drake.poses import Array, make_pose
from physim_drake.storage.text import read_text

_logger = logging.getLogger(__name__)

MAX_XML_BYTES = 4_000_000
"""Longer descriptions are not read."""

# In glTF y is up. Drake turns such meshes so that z is, before it poses them.
_Z_UP = np.array(
    [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=np.float64
)
_SUFFIXES = (".sdf", ".urdf")


def find_described(folder: Path) -> list[ObjectEntry]:
    """Lists the objects that files in a folder, or one level below, describe.

    A file without a mesh to look at is left out. One with several links or meshes is
    left out, too, and a warning names it. All objects have number 0.

    Args:
        folder: of `.sdf` or `.urdf` files.

    Raises:
        InputError: if a file cannot be read, or a mesh is missing.
    """
    paths = [p for pattern in ("*", "*/*") for p in folder.glob(pattern)]
    files = sorted(p for p in paths if p.suffix.lower() in _SUFFIXES and p.is_file())
    named = {p.with_suffix(""): p for p in reversed(files)}  # SDFormat before URDF
    entries = (_read(folder, path) for path in sorted(named.values()))
    return [entry for entry in entries if entry is not None]


def _read(folder: Path, path: Path) -> ObjectEntry | None:
    try:
        root = ET.fromstring(read_text(path, MAX_XML_BYTES, "XML"))
    except ET.ParseError as error:
        raise InputError(path, f"is not valid XML: {error}", "write it again") from None
    meshes = [
        (link, visual, mesh)
        for link in root.iter("link")
        for visual in link.iter("visual")
        for mesh in visual.iter("mesh")
    ]
    if not meshes:
        return None
    if len(meshes) > 1:
        _logger.warning(
            "%s is not read as an object: it has %d visual meshes", path, len(meshes)
        )
        return None
    link, visual, mesh = meshes[0]
    model = root if root.tag == "robot" else root.find("model")
    name = path.stem if model is None else model.get("name", path.stem)
    uri = mesh.get("filename") or mesh.findtext("uri") or ""
    mass, inertia = _inertia(path, link)
    file = _find_mesh(folder, path, uri.strip())
    pose = _pose(path, visual, link.get("name", ""))
    if file.suffix.lower() in (".gltf", ".glb"):
        pose = pose @ _Z_UP
    return ObjectEntry(
        0,
        name,
        file,
        unit=_scale(path, mesh),
        mass=mass,
        pose=pose,
        inertia=inertia,
    )


def _inertia(path: Path, link: ET.Element) -> tuple[float | None, GivenInertia | None]:
    inertial = link.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    if inertial is None or mass is None:
        return None, None
    kilograms = _numbers(path, mass.get("value") or mass.text, 1)[0]
    if kilograms <= 0:
        raise InputError(path, f"is {kilograms:g}", "must be positive", "mass")
    tensor = inertial.find("inertia")
    if tensor is None:
        return float(kilograms), None
    moments = np.zeros((3, 3))
    for i, j in zip(*np.triu_indices(3), strict=True):
        tag = "i" + "xyz"[i] + "xyz"[j]
        value = _numbers(path, tensor.get(tag) or tensor.findtext(tag) or "0", 1)[0]
        moments[i, j] = moments[j, i] = value
    if np.linalg.eigvalsh(moments)[0] <= 0:
        return float(kilograms), None
    X = _pose(path, inertial, link.get("name", ""))
    R = X[:3, :3]
    return float(kilograms), GivenInertia(X[:3, 3], R @ moments @ R.T)


def _pose(path: Path, element: ET.Element, link: str) -> Array:
    """The pose (4, 4), m, of an element in its link."""
    origin, pose = element.find("origin"), element.find("pose")
    if origin is not None:
        xyz = _numbers(path, origin.get("xyz", "0 0 0"), 3)
        turn = Rotation.from_euler("xyz", _numbers(path, origin.get("rpy", "0 0 0"), 3))
        return make_pose(np.asarray(turn.as_matrix()), xyz)
    if pose is None or not (pose.text or "").strip():
        return np.eye(4)
    if pose.get("relative_to", link) != link:
        raise InputError(
            path, "has a pose relative_to another frame", "give it in its link", "pose"
        )
    if pose.get("rotation_format") == "quat_xyzw":
        values = _numbers(path, pose.text, 7)
        turn = Rotation.from_quat(values[3:])
    else:
        values = _numbers(path, pose.text, 6)
        degrees = pose.get("degrees") in ("true", "1")
        turn = Rotation.from_euler("xyz", values[3:], degrees=degrees)
    return make_pose(np.asarray(turn.as_matrix()), values[:3])


def _scale(path: Path, mesh: ET.Element) -> float:
    scale = _numbers(path, mesh.get("scale") or mesh.findtext("scale") or "1 1 1", 3)
    if scale.min() <= 0 or np.ptp(scale) > 1e-9 * scale.max():
        raise InputError(
            path,
            f"is {' '.join(f'{x:g}' for x in scale)}",
            "only one positive factor for all axes is read: scale the mesh itself",
            "scale",
        )
    return float(scale[0])


def _numbers(path: Path, text: str | None, count: int) -> Array:
    try:
        values = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        values = np.zeros(0)
    if len(values) != count or not np.isfinite(values).all():
        shown = ascii(text)[:60]
        raise InputError(path, f"says {shown}", f"give {count} finite numbers")
    return values


def _find_mesh(folder: Path, path: Path, uri: str) -> Path:
    """The file below `folder` that a URI stands for.

    `package://` and `model://` name a package whose place is not known here: the
    longest end of the path that is there, seen from the description's folder or one
    above it, is taken.
    """
    scheme, _, rest = uri.rpartition("://")
    parts = [part for part in PurePosixPath(rest).parts if part != "/"]
    bases = [path.parent]
    while bases[-1] != folder and folder in bases[-1].parents:
        bases.append(bases[-1].parent)
    for start in range(len(parts) if scheme else 1):
        for base in bases:
            candidate = base.joinpath(*parts[start:])
            inside = candidate.resolve().is_relative_to(folder.resolve())
            if parts and inside and candidate.is_file():
                return candidate
    raise InputError(
        path,
        f"names {uri[:80]!a}, which is not below {folder}",
        "put the mesh there",
        "mesh",
    )
