# SPDX-License-Identifier: MIT
"""The system's libraries that Drake needs, and the Debian packages that hold them."""

from __future__ import annotations

import re

PACKAGES = {
    "libglib-2.0.so.0": "libglib2.0-0",
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libOpenGL.so.0": "libopengl0",
    "Mesa's drivers": "libgl1-mesa-dri",
    "libXrender.so.1": "libxrender1",
}
"""What a minimal Debian 12 or 13 lacks, as in requirements/system_libraries.sh."""

INSTALL = f"apt-get install {' '.join(PACKAGES.values())} (as root)"
"""The command that installs all of them."""

_NOT_FOUND = re.compile(r"(\S+\.so[.\d]*): cannot open shared object file")


def library_remedy(text: str) -> str:
    """Advice on the library that the loader misses.

    Args:
        text: message of an error.

    Returns:
        the advice, empty if the message is about something else.
    """
    missing = _NOT_FOUND.search(text)
    if missing is None:
        return ""
    library = missing[1]
    if library in PACKAGES:
        return f"apt-get install {PACKAGES[library]} (as root)"
    return f"install the package of your system that holds {library}"
