# SPDX-License-Identifier: MIT
"""Reads depth, colour and mask images from files that may be damaged.

OpenCV decodes them. Size, structure and checksums of the file are checked before, since
OpenCV would accept some damaged files and crash on others.
"""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physim_drake.errors import InputError
from physim_drake.observation.observation import Mask

MAX_PIXELS = 64_000_000
"""Largest image that is decoded, in pixels (8000 x 8000)."""

MAX_FILE_BYTES = 8 * MAX_PIXELS
"""Largest image file that is read: four 16-bit channels, uncompressed."""

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# Start-of-frame markers: all of 0xC0..0xCF but DHT, JPG and DAC.
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


def read_depth(path: Path) -> NDArray[np.uint16]:
    """Reads a depth image (height, width) in the file's own unit, 0 = unmeasured.

    Raises:
        InputError: if the file is missing, damaged, too large, not single-channel
            16 bit, or zero everywhere.
    """
    image: NDArray[Any] = _decode(path, cv2.IMREAD_UNCHANGED)
    if image.dtype != np.uint16 or image.ndim != 2:
        channels = 1 if image.ndim == 2 else image.shape[2]
        raise InputError(
            path,
            f"is {image.dtype} with {channels} channel(s)",
            "save depth as a single-channel 16-bit PNG",
        )
    if not image.any():
        raise InputError(path, "is zero everywhere", "record the depth image again")
    return image


def read_color(path: Path) -> NDArray[np.uint8]:
    """Reads a colour or grey image as RGB, (height, width, 3) uint8.

    Raises:
        InputError: if the file is missing, damaged or too large.
    """
    # An EXIF rotation must not be applied, since the depth image is not rotated.
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    return np.ascontiguousarray(_decode(path, flags)[..., ::-1])


def read_mask(path: Path) -> Mask:
    """Reads a mask (height, width) that is true where the image is not zero.

    Raises:
        InputError: if the file is missing, damaged or too large.
    """
    return np.asarray(_decode(path, cv2.IMREAD_GRAYSCALE) > 0)


def png_size(path: Path) -> tuple[int, int]:
    """Width and height in pixels, read from the head of a PNG file.

    Raises:
        InputError: if the file is missing, is not a PNG or is too large.
    """
    return _check(path, _read(path, limit=24), structure=False)


def _decode(path: Path, flags: int) -> NDArray[Any]:
    data = _read(path)
    width, height = _check(path, data, structure=True)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        image = None
    if image is None or image.shape[:2] != (height, width):
        raise _damaged(path, "cannot be decoded")
    return np.asarray(image)


def _read(path: Path, limit: int = -1) -> bytes:
    try:
        if path.exists() and not path.is_file():
            raise InputError(path, "is not a file", "give an image file")
        if (size := path.stat().st_size) > MAX_FILE_BYTES:
            raise InputError(
                path, f"has {size} bytes", f"at most {MAX_FILE_BYTES} are read"
            )
        with path.open("rb") as file:
            return file.read(limit)
    except OSError as error:
        raise InputError(
            path, f"cannot be read: {error.strerror or error}", "check the path"
        ) from None


def _check(path: Path, data: bytes, *, structure: bool) -> tuple[int, int]:
    """Width and height; raises `InputError` if the file cannot be an image."""
    if data.startswith(_PNG_SIGNATURE):
        if structure:
            _check_png_chunks(path, data)
        if len(data) < 24 or data[12:16] != b"IHDR":
            raise _damaged(path, "has no PNG header")
        width = int.from_bytes(data[16:20], "big")
        height = int.from_bytes(data[20:24], "big")
    elif data.startswith(b"\xff\xd8"):
        if structure and b"\xff\xd9" not in data[-64:]:
            raise _damaged(path, "is a JPEG cut short")
        width, height = _jpeg_size(path, data)
    else:
        raise _damaged(path, "is neither PNG nor JPEG")
    if not 0 < width * height <= MAX_PIXELS:
        raise InputError(
            path,
            f"says it is {width} x {height} pixels",
            f"images may have 1 to {MAX_PIXELS} pixels",
        )
    return width, height


def _check_png_chunks(path: Path, data: bytes) -> None:
    """Walks the chunks up to IEND and compares their checksums.

    OpenCV only warns of a wrong checksum, and its versions treat truncated files
    differently.
    """
    position = len(_PNG_SIGNATURE)
    while position + 12 <= len(data):
        length = int.from_bytes(data[position : position + 4], "big")
        end = position + 8 + length
        if end + 4 > len(data):
            break
        kind = data[position + 4 : position + 8]
        checksum = int.from_bytes(data[end : end + 4], "big")
        if zlib.crc32(data[position + 4 : end]) != checksum:
            raise _damaged(path, f"has a wrong checksum at byte {position}")
        if kind == b"IEND":
            return
        position = end + 4
    raise _damaged(path, f"is a PNG cut short after {len(data)} bytes")


def _jpeg_size(path: Path, data: bytes) -> tuple[int, int]:
    """Finds the frame header among the segments."""
    position = 2
    while position + 9 <= len(data) and data[position] == 0xFF:
        marker = data[position + 1]
        if marker in _JPEG_FRAMES:
            height = int.from_bytes(data[position + 5 : position + 7], "big")
            width = int.from_bytes(data[position + 7 : position + 9], "big")
            return width, height
        if marker == 0xFF:  # fill byte
            position += 1
        else:
            length = int.from_bytes(data[position + 2 : position + 4], "big")
            position += 2 + length
    raise _damaged(path, "has no JPEG frame header")


def _damaged(path: Path, problem: str) -> InputError:
    return InputError(path, problem, "copy or export the image again")
