# SPDX-License-Identifier: MIT
"""Images that are named SCENE/IMAGE."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from physim_drake.datasets.bop import ImageId, Target
from physim_drake.errors import InputError


def choose_images(
    targets: Sequence[Target], names: Iterable[str] = (), source: str = "images"
) -> list[ImageId]:
    """The images of the targets, or those of them that are named SCENE/IMAGE.

    Args:
        targets: objects to look for.
        names: the images to choose, as in "1/0"; all of the targets' if empty.
        source: what the names come from, as errors call it.

    Raises:
        InputError: if a name is malformed or its image has no target.
    """
    known = list(dict.fromkeys((t.scene_id, t.im_id) for t in targets))
    chosen = []
    for name in names:
        image = _parse(name, source)
        if image not in known:
            some = ", ".join(f"{s}/{i}" for s, i in known[:5])
            more = ", ..." if len(known) > 5 else ""
            raise InputError(source, f"{name} has no target", f"there are {some}{more}")
        chosen.append(image)
    return list(dict.fromkeys(chosen)) or known


def parse_images(names: Iterable[str], source: str = "images") -> list[ImageId]:
    """Scene and image ids of images that are named SCENE/IMAGE.

    Args:
        names: the names, as in "1/0".
        source: what the names come from, as errors call it.

    Raises:
        InputError: if a name is malformed.
    """
    return [_parse(name, source) for name in names]


def _parse(name: str, source: str) -> ImageId:
    scene, _, image = name.partition("/")
    if not (_is_id(scene) and _is_id(image)):
        raise InputError(
            source, f"{name!r} is not an image", "give SCENE/IMAGE, as in 1/0"
        )
    return int(scene), int(image)


def _is_id(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) < 10
