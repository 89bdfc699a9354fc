# SPDX-License-Identifier: MIT
"""The files beside a mesh that it may name: materials and textures.

A name in a file is followed only to files below the folder of the mesh. An absolute
name, or one that climbs out with "..", is taken for its last part, which must lie in
that folder: exporters write the paths of the computer that they ran on.
"""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath

from trimesh.resolvers import Resolver

from physim_drake.objects.glb_limits import MAX_PIXELS_OF_ALL, texture_pixels

MAX_ASSET_BYTES = 256_000_000
"""Larger materials and textures are not read."""

_MAX_HEADER = 65536  # bytes in which a mesh names its material or texture


class FolderResolver(Resolver):  # type: ignore[misc]
    """Gives a mesh loader the files of one folder and no others.

    Args:
        folder: of the mesh.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._pixels = 0

    def get(self, key: str) -> bytes:
        """The bytes of a file; raises `FileNotFoundError` if it may not be had."""
        path = find_asset(self._folder, key)
        if path is None:
            raise FileNotFoundError(key)
        data = path.read_bytes()
        if path.suffix.lower() == ".ktx2":
            raise FileNotFoundError(key)  # trimesh and Pillow do not decode it
        if path.suffix.lower() not in (".mtl", ".bin"):
            self._pixels += texture_pixels(data)
            if self._pixels > MAX_PIXELS_OF_ALL:
                raise ValueError("uses too many textures")
        return data

    def keys(self) -> list[str]:
        """None: files are found by their name alone."""
        return []

    def write(self, name: str, data: object) -> None:
        """Never: meshes are read only."""
        raise PermissionError(name)

    def namespaced(self, namespace: str) -> FolderResolver:
        """The same: there is one folder."""
        return self


def find_asset(folder: Path, name: str) -> Path | None:
    """The file that a name in a mesh file stands for, or None.

    Args:
        folder: of the mesh.
        name: as it stands in the file.
    """
    parts = PurePosixPath(name.strip().replace("\\", "/")).parts
    if not parts or "\0" in name:
        return None
    climbs = ".." in parts or parts[0] == "/" or parts[0].endswith(":")
    path = folder / parts[-1] if climbs else folder.joinpath(*parts)
    try:
        small = path.is_file() and path.stat().st_size <= MAX_ASSET_BYTES
    except OSError:  # a name that no file can have
        return None
    return path if small and parts[-1] != ".." else None


def find_texture(path: Path) -> Path | None:
    """Returns the image that an OBJ or PLY file names as its texture, if it exists."""
    folder, kind = path.parent, path.suffix.lower()
    if kind not in (".ply", ".obj"):
        return None
    with path.open("rb") as file:
        head = file.read(_MAX_HEADER)
    if kind == ".ply":
        names = _matches(rb"^comment TextureFile (.+)$", head)
    else:
        libraries = (find_asset(folder, n) for n in _matches(rb"^mtllib (.+)$", head))
        names = [
            name
            for library in libraries
            if library is not None
            for name in _matches(rb"^\s*map_Kd (.+)$", library.read_bytes())
        ]
    images = (find_asset(folder, name) for name in names)
    return next((image for image in images if image and _is_usable(image)), None)


def _is_usable(path: Path) -> bool:
    """Whether it is an image of a usual format, and not too large."""
    try:
        texture_pixels(path.read_bytes())
    except (OSError, ValueError):
        return False
    return True


def _matches(pattern: bytes, text: bytes) -> list[str]:
    found = re.findall(pattern, text, re.MULTILINE)
    return [name.decode("utf-8", "replace").strip() for name in found]
