# SPDX-License-Identifier: MIT
"""Annotations, as those need them who check values against them."""

from __future__ import annotations

import typing
from typing import Any


def without_alias(hint: Any) -> Any:
    """The type that a `type` alias stands for; any other type as it is.

    `numpy.typing.NDArray` is such an alias from numpy 2.5 on (PEP 695), so that
    `typing.get_origin` of ``NDArray[np.float32]`` is the alias and not `numpy.ndarray`.
    """
    alias = typing.get_origin(hint) or hint
    value = getattr(alias, "__value__", None)
    if value is None:
        return hint
    arguments = typing.get_args(hint)
    return without_alias(value[arguments] if arguments else value)
