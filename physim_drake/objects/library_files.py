# SPDX-License-Identifier: MIT
"""Finds the objects that a folder holds, in any of three layouts; reads no mesh.

1. `library.yaml` at the root, with meshes in metres if `unit` says nothing else. Only
   id and mesh are needed. Paths are relative to the folder. A symmetry matrix is 16
   numbers row-wise, in metres::

       objects:
       - id: 1
         name: crayola_24_ct
         mesh: crayola_24_ct/crayola_24_ct.obj
         unit: mm
         scale: 1.02
         collision: [crayola_24_ct/crayola_24_ct_collision_0.obj]
         mass: 0.22
         friction: 0.8
         symmetry:
           discrete: [[-1, 0, 0, 0,  0, -1, 0, 0,  0, 0, 1, 0,  0, 0, 0, 1]]
           continuous: [{axis: [0, 1, 0], point: [0, 0, 0]}]

2. A BOP `models` folder: `obj_000001.ply` ... in millimetres, and `models_info.json`.
3. Any OBJ, PLY, STL, GLB or glTF files in metres, in the folder or one level below,
   numbered from 1 in the natural order of their names; or YCB's folders, one for each
   object. `mesh_folders` tells objects from their copies and convex pieces. SDFormat
   and URDF files, each of one mesh, describe an object in the frame of its link.
"""

# No postponed annotations here: Drake's YAML loader reads the types themselves.
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from pydrake.common.yaml import yaml_load_typed

from physim_drake.errors import InputError
from physim_drake.objects.descriptions import find_described
from physim_drake.objects.mesh_folders import (
    find_meshes,
    natural_order,
    unread_files,
    warn_of_unread_files,
)
from physim_drake.objects.mesh_limits import CONVERSIONS
from physim_drake.objects.meshes import MESH_SUFFIXES, read_raw_mesh
from physim_drake.objects.object_entry import DEFAULT_FRICTION as DEFAULT_FRICTION
from physim_drake.objects.object_entry import ObjectEntry as ObjectEntry
from physim_drake.poses import ContinuousAxis, SymmetryGroup, is_rotation
from physim_drake.storage.json_nodes import MAX_ID, read_json
from physim_drake.storage.text import read_text
from physim_drake.storage.yaml_limits import MAX_YAML_BYTES, check_yaml

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}
"""Metres per unit of length, by the unit's name."""

LIBRARY_FILE = "library.yaml"
BOP_FILE = "models_info.json"
_LARGEST_IN_METRES = 5.0
MAX_NAME = 100
"""Longest name of an object."""


@dataclass
class AxisConfig:
    """A continuous axis of symmetry."""

    # Direction in O, of any length.
    axis: list[float] = field(default_factory=list)
    # A point on the axis, m.
    point: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])


@dataclass
class SymmetryConfig:
    """The symmetries of an object; an empty one states that there are none."""

    # X_OS row-wise, 16 numbers each, m; the identity may be left out.
    discrete: list[list[float]] = field(default_factory=list)
    continuous: list[AxisConfig] = field(default_factory=list)


@dataclass
class ObjectConfig:
    """One object of a `library.yaml`."""

    id: int = 0
    name: str = ""
    # File of the visual surface, relative to the folder.
    mesh: str = ""
    # Unit of length in the files of this object: m, cm, mm or in.
    unit: str = "m"
    # Factor on the size of the meshes, after the unit.
    scale: float = 1.0
    # Files of convex pieces, relative to the folder; computed if there are none.
    collision: list[str] = field(default_factory=list)
    # kg; from the volume if it is not given.
    mass: float | None = None
    friction: float = DEFAULT_FRICTION
    # Found from the shape if it is not given.
    symmetry: SymmetryConfig | None = None


@dataclass
class LibraryConfig:
    """A whole `library.yaml`."""

    objects: list[ObjectConfig] = field(default_factory=list)


def find_objects(folder: Path) -> list[ObjectEntry]:
    """Lists the objects in a folder, by id.

    Raises:
        InputError: if the folder is missing or holds no object, or its description
            cannot be used.
    """
    if not folder.is_dir():
        raise InputError(folder, "is no folder", "give a folder of object models")
    if (folder / LIBRARY_FILE).is_file():
        entries = _read_library(folder)
    elif (folder / BOP_FILE).is_file() or any(
        p.suffix.lower() in (".ply", ".glb") for p in folder.glob("obj_[0-9]*")
    ):
        entries = _read_bop(folder)
    else:
        entries = _read_loose(folder)
    if not entries:
        raise _nothing_found(folder)
    seen: dict[int, str] = {}
    for entry in entries:
        if entry.object_id in seen:
            raise InputError(
                folder,
                f"gives id {entry.object_id} to {seen[entry.object_id]} and "
                f"{entry.name}",
                "number each object once",
            )
        seen[entry.object_id] = entry.name
    return sorted(entries, key=lambda entry: entry.object_id)


def _read_library(folder: Path) -> list[ObjectEntry]:
    path = folder / LIBRARY_FILE
    text = read_text(path, MAX_YAML_BYTES, "YAML")
    try:
        check_yaml(text)
        config = yaml_load_typed(schema=LibraryConfig, data=text)
    # The loader reports a wrong type by whatever fails first, assertions included.
    except Exception as error:
        reason = " ".join(str(error).split())[:200] or "a value has the wrong type"
        raise InputError(
            path,
            f"cannot be used ({reason})",
            "give id, name, mesh, unit, scale, collision, mass, friction, symmetry",
            "objects",
        ) from error
    return [_library_entry(path, i, item) for i, item in enumerate(config.objects)]


def _library_entry(path: Path, index: int, config: ObjectConfig) -> ObjectEntry:
    where = f"objects[{index}]"
    if config.id < 1:
        raise InputError(path, f"is {config.id}", "give a positive id", f"{where}.id")
    if config.id > MAX_ID:
        raise InputError(path, f"is {config.id}", f"ids go to {MAX_ID}", f"{where}.id")
    if not config.mesh:
        raise InputError(path, "is missing", "name the mesh file", f"{where}.mesh")
    name = config.name or Path(config.mesh).stem
    if len(name) > MAX_NAME or not name.isprintable():
        raise InputError(
            path,
            f"is {name[:40]!a}",
            f"give at most {MAX_NAME} printable characters",
            f"{where}.name",
        )
    if config.unit not in UNITS:
        known = ", ".join(UNITS)
        raise InputError(
            path, f"is {config.unit[:40]!a}", f"give one of {known}", f"{where}.unit"
        )
    positive = ("mass", "friction", "scale")
    for key, value in ((key, getattr(config, key)) for key in positive):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise InputError(path, f"is {value}", "must be positive", f"{where}.{key}")
    symmetry = None
    if config.symmetry is not None:
        axes = [(a.axis, a.point) for a in config.symmetry.continuous]
        symmetry = make_symmetry(
            path, f"{where}.symmetry", config.symmetry.discrete, axes, 1.0
        )
    return ObjectEntry(
        config.id,
        name,
        _below(path, config.mesh, f"{where}.mesh"),
        unit=UNITS[config.unit] * config.scale,
        collision=tuple(
            _below(path, piece, f"{where}.collision") for piece in config.collision
        ),
        mass=config.mass,
        friction=config.friction,
        symmetry=symmetry,
    )


def _below(path: Path, name: str, where: str) -> Path:
    """The file of this name in the library's folder or below."""
    if Path(name).is_absolute() or ".." in Path(name).parts or not name.isprintable():
        raise InputError(
            path,
            f"is {name[:80]!a}",
            "meshes must lie in the library's folder or below; give a path from there",
            where,
        )
    return path.parent / name


def _read_bop(folder: Path) -> list[ObjectEntry]:
    path = folder / BOP_FILE
    infos: Mapping[str, object] = {}
    if path.is_file():
        infos = read_json(path).value
        if not isinstance(infos, dict):
            raise InputError(path, "is no JSON object", "map each id to its facts")
    entries = []
    meshes = [*folder.glob("obj_*.ply")]
    present = {path.stem for path in meshes}
    meshes += [path for path in folder.glob("obj_*.glb") if path.stem not in present]
    for mesh in meshes:
        match = re.fullmatch(r"obj_([0-9]{1,6})", mesh.stem)
        if match:
            object_id = int(match[1])
            info = infos.get(str(object_id), {})
            entries.append(
                ObjectEntry(
                    object_id,
                    mesh.stem,
                    mesh,
                    unit=1e-3 if mesh.suffix == ".ply" else _glb_unit(mesh, info),
                    symmetry=_bop_symmetry(path, str(object_id), info),
                )
            )
    return entries


def _glb_unit(path: Path, info: object) -> float:
    """Metres per unit: GLB says metres, BOP millimetres, `models_info.json` decides."""
    size = float(np.linalg.norm(read_raw_mesh(path).extents))
    stated = info.get("diameter") if isinstance(info, dict) else None
    if not isinstance(stated, (int, float)) or not 0 < stated < 1e6:
        return 1.0 if size < _LARGEST_IN_METRES else 1e-3
    return min((1.0, 1e-3), key=lambda unit: abs(np.log(size * unit * 1e3 / stated)))


def _bop_symmetry(path: Path, key: str, info: object) -> SymmetryGroup | None:
    if not isinstance(info, dict):
        raise InputError(path, "is no JSON object", "give the object's facts", key)
    if "symmetries_discrete" not in info and "symmetries_continuous" not in info:
        return None
    discrete = info.get("symmetries_discrete", [])
    continuous = info.get("symmetries_continuous", [])
    if not isinstance(discrete, list) or not isinstance(continuous, list):
        raise InputError(path, "symmetries are no lists", "see the BOP format", key)
    axes = []
    for item in continuous:
        if not isinstance(item, dict) or "axis" not in item:
            raise InputError(
                path,
                f"is {ascii(item)[:80]}",
                "give axis and offset",
                f"{key}.symmetries_continuous",
            )
        axes.append((item["axis"], item.get("offset", [0.0, 0.0, 0.0])))
    return make_symmetry(path, key, discrete, axes, 1e-3)


def make_symmetry(
    source: Path,
    field_name: str,
    discrete: Sequence[Sequence[float]],
    axes: Sequence[tuple[Sequence[float], Sequence[float]]],
    unit: float,
) -> SymmetryGroup:
    """Builds a symmetry group from numbers in a file.

    Args:
        source: the file, for messages.
        field_name: the part of the file, for messages.
        discrete: 4 x 4 matrices row-wise, with or without the identity.
        axes: direction and point of each continuous axis.
        unit: metres per unit of length in the file.

    Raises:
        InputError: if a matrix is not a rigid motion or an axis has no direction.
    """
    poses = [np.eye(4)]
    for i, numbers in enumerate(discrete):
        where = f"{field_name}.discrete[{i}]"
        X = _numbers(source, where, numbers, 16).reshape(4, 4)
        if not is_rotation(X[:3, :3]) or np.abs(X[3] - [0, 0, 0, 1]).max() > 1e-6:
            raise InputError(
                source, "is no rotation and translation", "write X row-wise", where
            )
        X[:3, 3] *= unit
        if np.abs(X - poses[0]).max() > 1e-6:
            poses.append(X)
    turns = []
    for i, (axis, point) in enumerate(axes):
        where = f"{field_name}.continuous[{i}]"
        direction = _numbers(source, where, axis, 3)
        length = float(np.linalg.norm(direction))
        if length < 1e-9:
            raise InputError(
                source, "has an axis of length 0", "give a unit axis", where
            )
        turns.append(
            ContinuousAxis(direction / length, _numbers(source, where, point, 3) * unit)
        )
    return SymmetryGroup(np.stack(poses), tuple(turns))


def _numbers(
    source: Path, where: str, values: object, count: int
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    try:
        array = np.array(values, dtype=np.float64).ravel()
    except (TypeError, ValueError, OverflowError):
        array = np.zeros(0)
    if len(array) != count or not np.isfinite(array).all():
        shown = ascii(values)[:80]
        raise InputError(source, f"is {shown}", f"give {count} finite numbers", where)
    return array


def _read_loose(folder: Path) -> list[ObjectEntry]:
    described = find_described(folder)
    # What lies beside a described mesh belongs to it.
    taken = {entry.mesh.parent for entry in described}
    found = [
        ObjectEntry(0, name, path)
        for name, path in find_meshes(folder)
        if path.parent not in taken
    ]
    if found:
        warn_of_unread_files(folder)
    entries = [*described, *found]
    if described:
        entries.sort(key=lambda entry: natural_order(entry.name))
    return [replace(entry, object_id=i) for i, entry in enumerate(entries, start=1)]


def _nothing_found(folder: Path) -> InputError:
    for path in unread_files(folder):
        return InputError(
            folder,
            f"holds no object models that are read, but {path.name}",
            f"convert it: {CONVERSIONS[path.suffix.lower()]}",
        )
    return InputError(
        folder,
        "holds no object models",
        f"put {LIBRARY_FILE}, a BOP models folder, or "
        f"{', '.join(MESH_SUFFIXES)} files there",
    )
