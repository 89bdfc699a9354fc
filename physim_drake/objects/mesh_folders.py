# SPDX-License-Identifier: MIT
"""Which files in a folder are objects, and which are copies or parts of one.

YCB's folders hold one object each, in several resolutions and formats. A mesh in
another format, a coarser copy and convex pieces are not further objects.
"""

from __future__ import annotations

import logging
import re
from pathlib import Path

from physim_drake.objects.mesh_limits import CONVERSIONS
from physim_drake.objects.meshes import MESH_SUFFIXES

_logger = logging.getLogger(__name__)

# Folders of one object's copies, the one to take first.
_RESOLUTIONS = ("google_16k", "google_64k", "google_512k", "poisson", "tsdf")
_MESH_FOLDERS = (*_RESOLUTIONS, "meshes", "mesh", "visual")
# Files that have the name of their kind rather than that of their object.
_GENERIC = ("textured", "textured_simple", "model", "mesh", "visual", "nontextured")
_PIECE = re.compile(r"collision|vhacd|coacd|convex_?(hull|part|piece|decomp)", re.I)
# With several formats, the first that keeps a texture.
_FORMATS = (".obj", ".glb", ".gltf", ".ply", ".stl")


def find_meshes(folder: Path) -> list[tuple[str, Path]]:
    """Lists names and mesh files of the objects in a folder and one level below.

    Args:
        folder: of mesh files, or of one folder for each object.

    Returns:
        the objects in the natural order of their names.
    """
    found = _named_files(folder)
    if not found:
        found = _best_copy(folder, _RESOLUTIONS)
    for below in sorted(path for path in folder.iterdir() if path.is_dir()):
        if below.name not in _RESOLUTIONS and not _PIECE.search(below.name):
            found += _one_object(below)
    return sorted(found, key=lambda item: (natural_order(item[0]), str(item[1])))


def unread_files(folder: Path) -> list[Path]:
    """Lists files in formats to convert that have no readable copy beside them."""
    files = [path for pattern in ("*", "*/*") for path in folder.glob(pattern)]
    readable = {p.with_suffix("") for p in files if p.suffix.lower() in MESH_SUFFIXES}
    return sorted(
        path
        for path in files
        if path.suffix.lower() in CONVERSIONS and path.with_suffix("") not in readable
    )


def warn_of_unread_files(folder: Path) -> None:
    """Logs a warning of each file that would have to be converted first."""
    for path in unread_files(folder):
        command = CONVERSIONS[path.suffix.lower()]
        _logger.warning("%s is not read; convert it: %s", path, command)


def _one_object(folder: Path) -> list[tuple[str, Path]]:
    """The objects of a folder in which there may be copies of one."""
    files = _named_files(folder)
    copies = [path for name, path in files if name in _GENERIC]
    if copies:
        best = min(copies, key=lambda path: _GENERIC.index(path.stem.lower()))
        own = [(name, path) for name, path in files if name not in _GENERIC]
        return [(folder.name, best), *own]
    return files or _best_copy(folder, _MESH_FOLDERS)


def _best_copy(folder: Path, names: tuple[str, ...]) -> list[tuple[str, Path]]:
    for name in names:
        if (folder / name).is_dir() and (found := _one_object(folder / name)):
            return [(folder.name, found[0][1])] if len(found) == 1 else found
    return []


def _named_files(folder: Path) -> list[tuple[str, Path]]:
    """Names and files of the meshes right in a folder, each in its best format."""
    best: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        suffix, stem = path.suffix.lower(), path.stem
        if suffix in _FORMATS and path.is_file() and not _PIECE.search(stem):
            other = best.get(stem)
            if other is None or _FORMATS.index(suffix) < _FORMATS.index(
                other.suffix.lower()
            ):
                best[stem] = path
    return list(best.items())


def natural_order(name: str) -> list[tuple[int, str]]:
    """Makes a key to sort by, by which `box2` comes before `box10`."""
    return [
        (int(part), "") if part.isdigit() else (-1, part.lower())
        for part in re.split(r"(\d+)", name)
    ]
