# SPDX-License-Identifier: MIT
"""What a binary glTF file may say of itself (glTF 2.0, sections 3.6 and 4.4)."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image

from physim_drake.errors import InputError

MAX_JSON_BYTES = 16_000_000
"""Longest description inside a GLB file."""

MAX_TEXTURE_PIXELS = 64_000_000
"""Largest texture image that is decoded, in pixels (8000 x 8000)."""

MAX_PIXELS_OF_ALL = 4 * MAX_TEXTURE_PIXELS
"""Of all textures of a mesh together, each as often as a material uses it."""

TEXTURE_FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "TGA", "TIFF")
"""Image formats of textures, as Pillow calls them."""

_MAX_NODES = 100_000
_COMPONENT_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_COMPONENTS = {
    "SCALAR": 1,
    "VEC2": 2,
    "VEC3": 3,
    "VEC4": 4,
    "MAT2": 4,
    "MAT3": 9,
    "MAT4": 16,
}


def check_glb(path: Path, data: bytes, max_faces: int) -> None:
    """Compares what a GLB file announces with its length and the limits.

    Args:
        path: for messages.
        data: the file.
        max_faces: of all instances of all its meshes together.

    Raises:
        InputError: if a number is impossible or a limit is exceeded.
    """
    with _named(path):
        tree, binary = _chunks(data)
        # Data from elsewhere are not needed: a GLB file is made to hold all its own.
        if any("uri" in buffer for buffer in tree.get("buffers", [])):
            raise ValueError("refers to other files")
        _check_tree(tree, len(binary), max_faces)
        _check_images(tree, binary)


def check_gltf(path: Path, data: bytes, max_faces: int) -> None:
    """Compares what a glTF file in JSON announces with its data file and the limits.

    Images are not looked at here: they are read as files, or not at all if they are in
    a format such as KTX2.

    Args:
        path: of the file, whose folder holds its data.
        data: the file.
        max_faces: of all instances of all its meshes together.

    Raises:
        InputError: if a number is impossible, a limit is exceeded, or the data are
            missing.
    """
    with _named(path):
        if len(data) > MAX_JSON_BYTES:
            raise ValueError(f"says its description has {len(data)} bytes")
        tree = json.loads(data, parse_constant=_reject)
        buffers = tree.get("buffers", [])
        if len(buffers) != 1:
            raise ValueError(f"has {len(buffers)} data buffers; one is read")
        name = str(buffers[0]["uri"])
        if name.startswith("data:"):
            size = len(base64.b64decode(name.partition(",")[2]))
        else:
            file = path.parent / name
            if Path(name).is_absolute() or ".." in Path(name).parts:
                raise ValueError(f"its data must lie beside it, not in {name[:60]!a}")
            if not file.is_file():
                raise ValueError(f"its data file {name[:60]!a} is missing")
            size = file.stat().st_size
        images = tree.get("images", [])
        if any(str(image.get("uri", "")).startswith("data:") for image in images):
            raise ValueError("holds images in its text; save it as GLB")
        if any("bufferView" in image for image in images):
            raise ValueError("holds images in its data; save it as GLB")
        _check_tree(tree, size, max_faces)


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Puts what is wrong with a description as an `InputError` that names the file."""
    try:
        yield
    except (KeyError, IndexError, TypeError, AttributeError, RecursionError) as error:
        problem = f"its description is no glTF ({type(error).__name__}: {error})"
        raise InputError(path, problem[:160], "export it again") from None
    except ValueError as error:
        raise InputError(path, str(error)[:160], "export it again") from None


def _chunks(data: bytes) -> tuple[dict[str, Any], bytes]:
    """The description and the first binary chunk."""
    if len(data) < 20 or data[:4] != b"glTF":
        raise ValueError("is no GLB file")
    length, kind = struct.unpack_from("<I4s", data, 12)
    if kind != b"JSON" or length > min(MAX_JSON_BYTES, len(data) - 20):
        raise ValueError(f"says its description has {length} bytes")
    tree = json.loads(data[20 : 20 + length], parse_constant=_reject)
    if not isinstance(tree, dict):
        raise ValueError("its description is no object")
    rest = data[20 + length :]
    if len(rest) < 8:
        return tree, b""
    size, kind = struct.unpack_from("<I4s", rest)
    if kind != b"BIN\0" or size > len(rest) - 8:
        raise ValueError(f"says its data have {size} bytes")
    return tree, rest[8 : 8 + size]


def _reject(name: str) -> None:
    raise ValueError(f"its description holds {name}")


def _check_tree(tree: dict[str, Any], binary: int, max_faces: int) -> None:
    views = tree.get("bufferViews", [])
    for view in views:
        end = _whole(view, "byteOffset", 0) + _whole(view, "byteLength")
        if _whole(view, "buffer") != 0 or end > binary:
            raise ValueError("a buffer view ends after its data")
        if "byteStride" in view and not 4 <= _whole(view, "byteStride") <= 252:
            raise ValueError("a stride is not in 4..252")
    counts = [
        _check_accessor(accessor, views) for accessor in tree.get("accessors", [])
    ]
    if sum(counts) > 20 * max_faces:
        raise ValueError(f"says it has {sum(counts)} values")
    meshes = [_mesh_size(mesh, counts) for mesh in tree.get("meshes", [])]
    nodes = tree.get("nodes", [])
    if len(nodes) > _MAX_NODES:
        raise ValueError(f"has {len(nodes)} nodes")
    total = sum(
        meshes[_index(node["mesh"], meshes)] for node in nodes if "mesh" in node
    )
    if max(total, *meshes, 0) > 3 * max_faces:
        raise ValueError(f"has {total // 3} faces, at most {max_faces} are read")


def _check_accessor(accessor: dict[str, Any], views: list[Any]) -> int:
    """The number of rows of an accessor, all of them inside its view."""
    count = _whole(accessor, "count")
    size = _COMPONENT_BYTES[accessor["componentType"]] * _COMPONENTS[accessor["type"]]
    if "bufferView" not in accessor or "sparse" in accessor:
        raise ValueError("holds sparse or missing values, which are not read")
    view = views[_index(accessor["bufferView"], views)]
    stride = view.get("byteStride", size)
    end = _whole(accessor, "byteOffset", 0) + max(count - 1, 0) * stride + size
    if count < 1 or end > view["byteLength"]:
        raise ValueError("an accessor ends after its buffer view")
    return count


def _mesh_size(mesh: dict[str, Any], counts: list[int]) -> int:
    """Corners of all triangles of a mesh, or its vertices if they are more."""
    size = 0
    for primitive in mesh["primitives"]:
        used = [*primitive["attributes"].values()]
        if "indices" in primitive:
            used.append(primitive["indices"])
        size += max(counts[_index(k, counts)] for k in used)
    return size


def _check_images(tree: dict[str, Any], binary: bytes) -> None:
    """Looks at the head of each image, as often as a material uses it."""
    pixels = [_image_pixels(image, tree, binary) for image in tree.get("images", [])]
    textures = tree.get("textures", [])
    total = sum(pixels)
    for material in tree.get("materials", []):
        for index in _texture_indices(material):
            source = textures[_index(index, textures)].get("source")
            if source is not None:
                total += pixels[_index(source, pixels)]
    if total > MAX_PIXELS_OF_ALL:
        raise ValueError(f"uses textures of {total} pixels in all")


def _image_pixels(image: dict[str, Any], tree: dict[str, Any], binary: bytes) -> int:
    if "bufferView" in image:
        view = tree["bufferViews"][_index(image["bufferView"], tree["bufferViews"])]
        start = view.get("byteOffset", 0)
        return texture_pixels(binary[start : start + view["byteLength"]])
    if str(image.get("uri", "")).startswith("data:"):
        return texture_pixels(base64.b64decode(image["uri"].partition(",")[2]))
    raise ValueError("refers to other files")


def _texture_indices(material: dict[str, Any]) -> Iterator[Any]:
    """The textures that a material names, at any depth."""
    for key, value in material.items():
        if key.endswith("Texture") and isinstance(value, dict) and "index" in value:
            yield value["index"]
        elif isinstance(value, dict):
            yield from _texture_indices(value)


def texture_pixels(data: bytes) -> int:
    """How many pixels an image says it has; nothing is decoded.

    Raises:
        ValueError: if that is too many, or it is not an image of a usual format.
    """
    try:
        # Of the formats that Pillow knows, some call other programs.
        with Image.open(BytesIO(data), formats=TEXTURE_FORMATS) as image:
            width, height = image.size
    except Exception as error:  # Pillow raises whatever its parsers come upon
        raise ValueError(f"has a texture that cannot be used ({error})") from None
    if width * height > MAX_TEXTURE_PIXELS:
        raise ValueError(
            f"has a texture of {width} x {height} pixels, "
            f"at most {MAX_TEXTURE_PIXELS} are read"
        )
    return int(width * height)


def _whole(values: dict[str, Any], key: str, default: int | None = None) -> int:
    value = values[key] if default is None else values.get(key, default)
    if type(value) is not int or not 0 <= value < 1 << 40:
        raise ValueError(f"{key} is {str(value)[:20]}")
    return value


def _index(value: Any, items: list[Any]) -> int:
    if type(value) is not int or not 0 <= value < len(items):
        raise ValueError(f"refers to number {str(value)[:20]} of {len(items)}")
    return value
