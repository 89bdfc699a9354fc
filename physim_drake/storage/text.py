# SPDX-License-Identifier: MIT
"""Reads text from files that may hold anything."""

from __future__ import annotations

from pathlib import Path

from physim_drake.errors import InputError


def read_text(path: Path, max_bytes: int, kind: str) -> str:
    """Reads a UTF-8 file, with or without a byte order mark, up to a limit.

    Args:
        path: file to read, which may be a pipe.
        max_bytes: greatest length of a file; no more than this is ever read.
        kind: name of the format, for messages.

    Raises:
        InputError: if it cannot be read, is too long, or is not UTF-8.
    """
    try:
        with path.open("rb") as file:
            data = file.read(max_bytes + 1)
    except OSError as error:
        raise InputError(
            path, f"cannot be read: {error.strerror or error}", "check the path"
        ) from None
    except ValueError:  # a null character in the name
        raise InputError(path, "is not a path", "check the path") from None
    if len(data) > max_bytes:
        raise InputError(
            path,
            f"has more than {max_bytes} bytes",
            "give a smaller file, or split it",
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            path,
            f"is not UTF-8 text (byte {error.start})",
            f"write it as UTF-8 {kind}",
        ) from None
