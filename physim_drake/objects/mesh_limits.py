# SPDX-License-Identifier: MIT
"""What a mesh file says about its size, checked before anything is made of it.

A header of a hundred bytes can ask for terabytes. Here the text or header of a file is
compared with the limits and with the length of the file, so that a parser never
allocates more than a fixed multiple of what is really there.
"""

from __future__ import annotations

import re
from pathlib import Path

from physim_drake.errors import InputError
from physim_drake.objects.glb_limits import check_glb, check_gltf

MAX_FACES = 2_000_000
"""Meshes with more faces are refused."""

MAX_VERTICES = 3 * MAX_FACES
"""And with more vertices."""

MAX_MESH_BYTES = 250 * MAX_FACES
"""Larger mesh files are not read."""

_BY_TRIMESH = "python -c \"import trimesh; trimesh.load('{0}').export('{1}')\""
_BY_CASCADIO = (
    "pip install cascadio; "
    "python -c \"import cascadio; cascadio.step_to_glb('FILE.step', 'FILE.glb')\""
)
CONVERSIONS = {
    ".step": _BY_CASCADIO,
    ".stp": _BY_CASCADIO,
    ".dae": "pip install pycollada; " + _BY_TRIMESH.format("FILE.dae", "FILE.glb"),
    ".off": _BY_TRIMESH.format("FILE.off", "FILE.ply"),
    ".fbx": "open it in Blender and export it as glTF binary (.glb)",
}
"""What makes a readable file of one that is not read, by its suffix in lower case."""

_MAX_LINES = 8 * MAX_FACES
_MAX_PLY_HEADER = 65536  # bytes
_MAX_PROPERTIES = 64  # of an element
_PLY_BYTES = {
    **dict.fromkeys(("char", "uchar", "int8", "uint8"), 1),
    **dict.fromkeys(("short", "ushort", "int16", "uint16", "float16"), 2),
    **dict.fromkeys(("int", "uint", "int32", "uint32", "float", "float32"), 4),
    **dict.fromkeys(("int64", "uint64", "double", "float64"), 8),
}
# What `str.splitlines` takes for the end of a line.
_LINE_ENDS = (b"\n", b"\r", b"\v", b"\f", b"\x1c", b"\x1d", b"\x1e")
_WIDE_LINE_ENDS = (b"\xc2\x85", b"\xe2\x80\xa8", b"\xe2\x80\xa9")


def read_mesh_file(path: Path) -> bytes:
    """Reads a mesh file whose claims are within the limits; text comes as UTF-8.

    Args:
        path: an OBJ, PLY, STL or GLB file.

    Raises:
        InputError: if it is missing, too large, or claims what it cannot hold.
    """
    suffix = path.suffix.lower()
    try:
        if not path.is_file():
            raise InputError(path, "does not exist", "check the name of the mesh file")
        if suffix in CONVERSIONS:
            raise InputError(
                path, f"{suffix} is not read", f"convert it: {CONVERSIONS[suffix]}"
            )
        if (size := path.stat().st_size) > MAX_MESH_BYTES:
            raise _too_large(path, f"has {size / 1e6:.0f} MB")
        data = path.read_bytes()
    except OSError as error:
        raise InputError(
            path, f"cannot be read: {error.strerror or error}", "check the path"
        ) from None
    if suffix == ".ply":
        _check_ply(path, data)
    elif suffix == ".glb":
        check_glb(path, data, MAX_FACES)
    elif suffix == ".gltf":
        check_gltf(path, data, MAX_FACES)
    elif suffix == ".obj":
        data = _as_utf8(data)
        _check_obj(path, data)
    elif not _is_binary_stl(data):
        data = _as_utf8(data)
        _check_lines(path, data)
    elif len(data) // 50 > MAX_FACES:
        raise _too_large(path, f"has {len(data) // 50} faces")
    return data


def _is_binary_stl(data: bytes) -> bool:
    return len(data) == 84 + 50 * int.from_bytes(data[80:84], "little")


def _as_utf8(data: bytes) -> bytes:
    """Text in UTF-8; any other encoding is taken for Latin-1 rather than guessed."""
    try:
        data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1").encode("utf-8")
    return data


def _check_lines(path: Path, data: bytes) -> None:
    count = sum(data.count(end) for end in (*_LINE_ENDS, *_WIDE_LINE_ENDS))
    if count > _MAX_LINES:
        raise _too_large(path, f"has {count} lines")


def _check_obj(path: Path, data: bytes) -> None:
    _check_lines(path, data)
    vertices = len(re.findall(rb"^[ \t]*v[ \t]", data, re.MULTILINE))
    if vertices > MAX_VERTICES:
        raise _too_large(path, f"has {vertices} vertices")
    # A face of n corners is n - 2 triangles.
    corners = sum(
        max(len(line.split()) - 2, 0)
        for line in re.findall(rb"^[ \t]*f[ \t]+([^\n]*)", data, re.MULTILINE)
    )
    if corners > MAX_FACES:
        raise _too_large(path, f"has {corners} faces")


def _check_ply(path: Path, data: bytes) -> None:
    """Compares the elements that the header announces with the file's length."""
    head = re.search(rb"^[ \t]*end_header[ \t\r]*\n", data[:_MAX_PLY_HEADER], re.M)
    if not data.startswith(b"ply") or head is None:
        raise _damaged(path, "is no readable mesh: it has no PLY header")
    ascii_text, elements = _ply_elements(path, data[: head.start()])
    limits = {"vertex": MAX_VERTICES, "face": MAX_FACES}
    total = 0
    for name, (count, row) in elements.items():
        if count > limits.get(name, MAX_VERTICES):
            raise _too_large(path, f"says it has {count} of {name}", name)
        total += count * row
    if ascii_text:
        data = data[head.end() :]
        _check_lines(path, data)
        return
    if total > len(data) - head.end():
        raise _damaged(
            path,
            f"is cut short: its header announces at least {total} bytes, "
            f"{len(data) - head.end()} follow",
        )


def _ply_elements(path: Path, head: bytes) -> tuple[bool, dict[str, tuple[int, int]]]:
    """Whether it is text; count and least bytes of a row of each element."""
    lines = [line.split() for line in head.decode("latin-1").split("\n")]
    elements: dict[str, tuple[int, int]] = {}
    name, properties, encoding = "", 0, ""
    for number, words in enumerate(lines[1:], start=2):
        kind = words[0] if words else ""
        if kind == "format" and len(words) == 3:
            encoding = words[1]
        elif kind == "element" and len(words) == 3 and re.fullmatch(r"\d+", words[2]):
            name, properties = words[1], 0
            if name in elements or len(words[2]) > 18:
                raise _damaged(path, f"has an impossible header (line {number})")
            elements[name] = int(words[2]), 0
        elif kind == "property" and name and words[1:2] and words[1] != "element":
            size = words[2] if words[1] == "list" and len(words) == 5 else words[1]
            properties += 1
            if size not in _PLY_BYTES or properties > _MAX_PROPERTIES:
                raise _damaged(path, f"has an impossible header (line {number})")
            count, row = elements[name]
            elements[name] = count, row + _PLY_BYTES[size]
        elif kind not in ("comment", "obj_info", ""):
            raise _damaged(path, f"has an impossible header (line {number})")
    if encoding not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise _damaged(path, "does not say how it is encoded")
    return encoding == "ascii", elements


def _too_large(path: Path, problem: str, field: str | None = None) -> InputError:
    return InputError(
        path, problem, f"reduce the mesh to fewer than {MAX_FACES} faces", field
    )


def _damaged(path: Path, problem: str) -> InputError:
    return InputError(path, problem, "copy or export it again")
