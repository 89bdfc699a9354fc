# SPDX-License-Identifier: MIT
"""Hypothesis strategies that spoil valid files."""

from __future__ import annotations

import json
from typing import Any

from hypothesis import strategies as st

_TOKENS = (
    *(b"-", b"9" * 30, b"null", b"[", b"}", b'"', b"e", b"1e999", b"NaN", b"\0"),
    *(b"\n", b"\xff\xff\xff\xff", b"../", b"/etc/passwd", b"&a ", b"*a ", b"-1 "),
    *(b"!!python/name:os ", b"9" * 12, b"[" * 3000, b'{"a":' * 3000, b"\xed\xa0\x80"),
)
_VALUES = st.sampled_from(
    [
        *(
            None,
            True,
            -1,
            0,
            1,
            1.5,
            -1e308,
            1 << 40,
            10**30,
            "",
            "a",
            "\ud800",
            "../x",
        ),
        *(
            [],
            {},
            [[]],
            {"0": {}},
            {"": []},
            "9" * 40,
            [None] * 9,
            [1e300] * 9,
            [0] * 9,
        ),
    ]
)


@st.composite
def mangled(draw: st.DrawFn, data: bytes) -> bytes:
    """`data` with some bytes changed, inserted or removed, or cut short."""
    result = bytearray(data)
    for _ in range(draw(st.integers(1, 4))):
        place = draw(st.integers(0, max(0, len(result) - 1)))
        removed = draw(st.integers(0, 4))
        result[place : place + removed] = draw(
            st.binary(max_size=4) | st.sampled_from(_TOKENS)
        )
    if draw(st.integers(0, 3)) == 0:
        del result[draw(st.integers(0, len(result))) :]
    return bytes(result)


@st.composite
def substituted(draw: st.DrawFn, text: str) -> bytes:
    """A JSON text with a value exchanged, a member removed, or a key given twice."""
    tree = json.loads(text)
    holders = list(_holders(tree))
    if not holders:
        return json.dumps(draw(_VALUES)).encode()
    holder, key = draw(st.sampled_from(holders))
    kind = draw(st.integers(0, 5))
    if kind == 0:
        del holder[key]
    elif kind == 1:
        name = json.dumps(str(key))
        return json.dumps(tree).replace(name, f"{name}: 1, {name}", 1).encode()
    else:
        holder[key] = draw(_VALUES)
    return json.dumps(tree).encode()


def _holders(value: Any) -> list[tuple[Any, Any]]:
    """Every list and object of a tree with each of its keys."""
    if isinstance(value, dict):
        keys: list[Any] = list(value)
    elif isinstance(value, list):
        keys = list(range(len(value)))
    else:
        return []
    below = [pair for key in keys for pair in _holders(value[key])]
    return [(value, key) for key in keys] + below


def inputs(seeds: tuple[bytes, ...]) -> st.SearchStrategy[bytes]:
    """Inputs of a target: its seeds spoilt, or any bytes."""
    strategies: list[st.SearchStrategy[bytes]] = [st.binary(max_size=200)]
    for seed in seeds:
        file = mangled(seed[1:])
        try:
            text = seed[1:].decode()
            json.loads(text)
            file |= substituted(text)
        except ValueError:
            pass
        strategies.append(file.map(lambda data, first=seed[:1]: first + data))
    return st.one_of(strategies)
