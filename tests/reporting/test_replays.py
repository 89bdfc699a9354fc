# SPDX-License-Identifier: MIT
from __future__ import annotations

import base64
import re

from pydrake.geometry import Box, Meshcat, Rgba, Sphere

from physim_drake.episodes.runner import local_meshcat
from physim_drake.reporting.replays import replay_page

_DATA = re.compile(r"data:application/octet-binary;base64,([A-Za-z0-9+/=]+)")


def show(meshcat: Meshcat, size: float = 1.0) -> str:
    meshcat.Delete()
    meshcat.SetObject("a/b", Box(size, 2, 3), Rgba(1, 0, 0, 1))
    meshcat.SetObject("a/c", Sphere(0.1), Rgba(1, 0, 0, 1))
    return replay_page(meshcat)


def test_a_page_does_not_depend_on_what_was_shown_before() -> None:
    meshcat = local_meshcat()
    first = show(meshcat)
    own = meshcat.StaticHtml()
    assert first == show(meshcat) == show(local_meshcat())
    assert meshcat.StaticHtml() != own
    assert show(meshcat, 2.0) != first


def test_only_the_numbers_differ_from_meshcat_s_own_page() -> None:
    meshcat = local_meshcat()
    page, own = show(meshcat), meshcat.StaticHtml()
    assert len(page) == len(own)
    data = [base64.b64decode(text) for text in _DATA.findall(page)]
    for old, new in zip(_DATA.findall(own), data, strict=True):
        plain = base64.b64decode(old)
        hexes = re.compile(rb"[0-9a-f]{8}-[0-9a-f-]{27}")
        assert hexes.sub(b"", plain) == hexes.sub(b"", new)
    numbers = set(re.findall(rb"([0-9a-f]{8})-0000-4000-8000", b"".join(data)))
    assert numbers == {b"%08x" % n for n in range(len(numbers))}
    assert len(numbers) >= 4  # a geometry and a material of each
    assert _DATA.sub("", page) == _DATA.sub("", own)
