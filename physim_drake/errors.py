# SPDX-License-Identifier: MIT
"""The exceptions that physim-drake raises on purpose."""

from __future__ import annotations

from pathlib import Path


class PhysimError(Exception):
    """Root of every error a user can cause; the CLI prints it as one line, exits 2."""


class InputError(PhysimError):
    """A file, or a value in one, cannot be used.

    Args:
        source: the file (or argument) at fault.
        problem: description of the fault, naming field and value.
        remedy: action that the user can take.
        field: the part of the source at fault, if there is one.
    """

    def __init__(
        self,
        source: Path | str,
        problem: str,
        remedy: str = "",
        field: str | None = None,
    ) -> None:
        self.source, self.problem, self.remedy, self.field = (
            str(source),
            problem,
            remedy,
            field,
        )
        where = f"{source}: {field}" if field else str(source)
        text = f"{where}: {problem}" + (f"; {remedy}" if remedy else "")
        super().__init__(_on_one_line(text))

    def about(self, source: Path | str) -> InputError:
        """The same error about another source.

        Args:
            source: the file or argument that the user gave; the present source, with
                its field, is a part of it and becomes the field.
        """
        inner = "" if self.source == str(source) else self.source
        field = ": ".join(x for x in (inner, self.field) if x)
        return InputError(source, self.problem, self.remedy, field or None)

    def __reduce__(self) -> tuple[type, tuple[str, str, str, str | None]]:
        """Pickles by the constructor's arguments, so that workers can send it."""
        return type(self), (self.source, self.problem, self.remedy, self.field)


def _on_one_line(text: str) -> str:
    """`text` with all that a terminal would obey or could not print escaped.

    Messages quote files, and a file may hold line ends and control sequences.
    """
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode() for c in text
    )
