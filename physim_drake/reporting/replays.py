# SPDX-License-Identifier: MIT
"""Replays of what Meshcat showed, as pages that open without a server."""

from __future__ import annotations

import base64
import re

from pydrake.geometry import Meshcat

_DATA = re.compile(r"(?<=data:application/octet-binary;base64,)[A-Za-z0-9+/=]+")
_HEX = rb"[0-9a-f]"
_ID = re.compile(_HEX + rb"{8}(?:-" + _HEX + rb"{4}){3}-" + _HEX + rb"{12}")


def replay_page(meshcat: Meshcat) -> str:
    """A page with everything that is shown, and its recording.

    Meshcat numbers all that it has ever been given, so that its own page depends on
    what it showed before. Here what is shown is numbered anew.
    """
    names: dict[bytes, bytes] = {}

    def renamed(found: re.Match[bytes]) -> bytes:
        name = b"%08x-0000-4000-8000-000000000000" % len(names)
        return names.setdefault(found[0], name)

    def numbered(found: re.Match[str]) -> str:
        data = _ID.sub(renamed, base64.b64decode(found[0]))
        return base64.b64encode(data).decode("ascii")

    return _DATA.sub(numbered, meshcat.StaticHtml())
