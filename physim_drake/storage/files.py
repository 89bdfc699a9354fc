# SPDX-License-Identifier: MIT
"""Writes files so that a reader never sees half of one."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, Literal, TextIO, overload

from physim_drake.errors import InputError
from physim_drake.storage.locks import hold, remove_abandoned

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def cannot_write(path: Path, error: OSError) -> InputError:
    """The `InputError` that says why `path` cannot be written."""
    remedy = "choose a path in a folder that exists and is writable"
    if error.errno in _FULL:
        remedy = "free some space there, or choose another place (for temporary files, "
        remedy += "with the variable TMPDIR)"
    return InputError(path, f"cannot be written: {error.strerror or error}", remedy)


def check_writable(path: Path) -> None:
    """Checks that a file can be made, before the work whose result it shall hold.

    Raises:
        InputError: if it cannot be made.
    """
    if not is_written_straight(path):
        try:
            with tempfile.TemporaryFile(dir=Path(os.path.realpath(path)).parent):
                pass
        except OSError as error:
            raise cannot_write(path, error) from error


@contextmanager
def reading(paths: Iterable[Path]) -> Iterator[None]:
    """Names the missing file if the block fails because a file was removed.

    Args:
        paths: files that are read by a library that only raises `RuntimeError`, as
            Drake does.

    Raises:
        InputError: if the block fails and one of them no longer exists.
    """
    try:
        yield
    except RuntimeError as error:
        for path in paths:
            if not path.exists():
                raise InputError(
                    path, "was removed during the run", "run again"
                ) from error
        raise


def make_folder(folder: Path) -> None:
    """Makes a folder and those above it, unless it exists.

    Raises:
        InputError: if it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from error


@overload
@contextmanager
def write_atomically(path: Path, mode: Literal["w"] = "w") -> Iterator[TextIO]: ...


@overload
@contextmanager
def write_atomically(path: Path, mode: Literal["wb"]) -> Iterator[IO[bytes]]: ...


@contextmanager
def write_atomically(path: Path, mode: str = "w") -> Iterator[Any]:
    """Gives a file to write that replaces `path` only if the block does not raise.

    The text (UTF-8, lines end in a plain newline) or bytes go to a temporary file in
    the same folder, are flushed to the disk and renamed. If the block raises, `path`
    stays as it was and the temporary file is removed. If the process is killed, the
    next one that writes `path` removes the temporary file. Symbolic links are followed.
    A pipe, or anything below /dev such as /dev/stdout, is written directly.

    Args:
        path: file to create or replace.
        mode: "w" for text or "wb" for bytes.

    Raises:
        InputError: if the folder or the file cannot be written.
    """
    target = Path(os.path.realpath(path))
    direct = is_written_straight(path)
    scratch = (
        target
        if direct
        else target.with_name(f"{_prefix(target)}{secrets.token_hex(4)}.tmp")
    )
    text = {} if "b" in mode else {"encoding": "utf-8", "newline": "\n"}
    try:
        with open(path if direct else scratch, mode, **text) as file:  # type: ignore[call-overload]
            if not direct:
                hold(file.fileno(), without_locks=True)
                remove_abandoned(_temporary_files(target), Path.unlink)
            yield file
            file.flush()
            if not direct:
                os.fsync(file.fileno())
                os.replace(scratch, target)
    except OSError as error:
        # The block may raise an error that is about another file.
        if error.filename not in (None, str(scratch), str(path)):
            raise
        raise cannot_write(path, error) from error
    finally:
        if not direct:
            with suppress(OSError):  # it was renamed, or never made
                scratch.unlink()


@contextmanager
def fill_folder(folder: Path) -> Iterator[Path]:
    """Gives a folder to fill that becomes `folder` only if the block does not raise.

    If the block raises, what it wrote is removed. If the process is killed, it stays
    under a name that begins with a dot and ends in ".tmp".

    Args:
        folder: folder to make; it must not exist, or be empty.

    Raises:
        InputError: if it cannot be written.
    """
    scratch = folder.with_name(f"{_prefix(folder)}{secrets.token_hex(4)}.tmp")
    try:
        scratch.mkdir()
        yield scratch
        os.rename(scratch, folder)
    except OSError as error:
        # The block may raise an error that is about another file.
        if error.filename and not Path(error.filename).is_relative_to(scratch):
            raise
        raise cannot_write(folder, error) from error
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def is_written_straight(path: Path) -> bool:
    """Whether a path leads to a pipe or device, which a file cannot replace."""
    return path.parts[:2] == ("/", "dev") or (path.exists() and not path.is_file())


def _prefix(target: Path) -> str:
    """Prefix of the names of a file's temporary files."""
    return f".{target.name[:64]}."


def _temporary_files(target: Path) -> list[Path]:
    """The temporary files of a file, of this process and of others."""
    prefix, length = _prefix(target), len(_prefix(target)) + 8 + len(".tmp")
    return [
        Path(entry.path)
        for entry in os.scandir(target.parent)
        if len(entry.name) == length
        and entry.name.startswith(prefix)
        and entry.name.endswith(".tmp")
    ]
