# SPDX-License-Identifier: MIT
from __future__ import annotations

import re
from pathlib import Path

import pytest

from physim_drake.doctor.system_libraries import PACKAGES, library_remedy

SCRIPT = Path(__file__).parents[2] / "requirements" / "system_libraries.sh"


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        (
            "ImportError: libglib-2.0.so.0: cannot open shared object file: No such "
            "file or directory",
            "apt-get install libglib2.0-0 (as root)",
        ),
        (
            "OSError: libodd.so.3: cannot open shared object file: No such file",
            "install the package of your system that holds libodd.so.3",
        ),
        ("RuntimeError: no display", ""),
    ],
)
def test_the_package_of_a_missing_library_is_named(text: str, remedy: str) -> None:
    assert library_remedy(text) == remedy


def test_the_setup_installs_the_same_packages() -> None:
    text = SCRIPT.read_text()
    for name, values in (("packages", PACKAGES.values()), ("libraries", PACKAGES)):
        listed = re.search(rf"^{name}=\((.*)\)$", text, re.MULTILINE)
        assert listed
        assert {*listed[1].split()} == {*values} - {"Mesa's drivers"}
