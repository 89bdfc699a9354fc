# SPDX-License-Identifier: MIT
from __future__ import annotations

import struct
import zlib
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from physim_drake.datasets.images import png_size, read_color, read_depth, read_mask
from physim_drake.errors import InputError, PhysimError
from tests.datasets.tiny import depth_image, mangled, write_image


def chunk(kind: bytes, data: bytes) -> bytes:
    checksum = struct.pack(">I", zlib.crc32(kind + data))
    return struct.pack(">I", len(data)) + kind + data + checksum


def png(width: int, height: int, pixels: bytes) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    return b"".join(
        [
            b"\x89PNG\r\n\x1a\n",
            chunk(b"IHDR", header),
            chunk(b"IDAT", pixels),
            chunk(b"IEND", b""),
        ]
    )


def test_depth_keeps_its_values(tmp_path: Path) -> None:
    path = tmp_path / "depth.png"
    write_image(path, depth_image())
    assert (read_depth(path) == depth_image()).all()
    assert png_size(path) == (12, 8)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.ones((4, 4), np.uint8), "is uint8"),
        (np.ones((4, 4, 3), np.uint16), r"3 channel\(s\)"),
        (np.zeros((4, 4), np.uint16), "zero everywhere"),
    ],
)
def test_depth_of_another_kind(tmp_path: Path, image: np.ndarray, message: str) -> None:
    path = tmp_path / "depth.png"
    write_image(path, image)
    with pytest.raises(InputError, match=message):
        read_depth(path)


def test_every_cut_of_a_file_is_noticed(tmp_path: Path) -> None:
    for name in ("image.png", "image.jpg"):
        path = tmp_path / name
        rng = np.random.default_rng(0)
        write_image(path, rng.integers(0, 255, (9, 9, 3), dtype=np.uint8))
        data = path.read_bytes()
        for length in range(len(data) - 1):
            path.write_bytes(data[:length])
            with pytest.raises(InputError, match="image"):
                read_color(path)


def test_pixels_cut_short_within_a_whole_file(tmp_path: Path) -> None:
    path = tmp_path / "depth.png"
    rows = b"".join(b"\0" + struct.pack(">4H", *range(1, 5)) for _ in range(4))
    path.write_bytes(png(4, 4, zlib.compress(rows)))
    assert read_depth(path)[3].tolist() == [1, 2, 3, 4]
    path.write_bytes(png(4, 4, zlib.compress(rows[:18])))
    with pytest.raises(InputError, match="decoded"):
        read_depth(path)


def test_enormous_images_are_not_decoded(tmp_path: Path) -> None:
    path = tmp_path / "bomb.png"
    path.write_bytes(png(200_000, 200_000, zlib.compress(b"")))
    for read in (read_depth, read_color, read_mask, png_size):
        with pytest.raises(InputError, match="200000 x 200000"):
            read(path)


def test_missing_and_special_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_depth(tmp_path / "none.png")
    with pytest.raises(InputError, match="not a file"):
        read_depth(tmp_path)
    (tmp_path / "text.png").write_text("hello")
    with pytest.raises(InputError, match="neither PNG nor JPEG"):
        read_color(tmp_path / "text.png")


@settings(
    max_examples=150,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_mangled_jpegs_raise_only_input_errors(
    tmp_path: Path, data: st.DataObject
) -> None:
    image = np.arange(300, dtype=np.uint8).reshape(10, 10, 3)
    encoded = cv2.imencode(".jpg", image)[1].tobytes()
    path = tmp_path / "image.jpg"
    path.write_bytes(data.draw(mangled(encoded)))
    with suppress(PhysimError):
        assert read_color(path).ndim == 3
