# SPDX-License-Identifier: MIT
"""COCO's run-length encoded masks.

Runs go down the columns, first of zeros. They are a list, or packed in a string: each
run in groups of 5 bits, lowest first, with a 6th bit if more follow, and from the
fourth run on as the difference to the run two before (the "compressed RLE" of
https://github.com/cocodataset/cocoapi, maskApi). COCO's own decoder trusts the string
and writes past the mask if the runs are too long, so it is not used here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physim_drake.observation.observation import Mask
from physim_drake.storage.json_nodes import JsonNode

Runs = NDArray[np.int64]
_MAX_GROUPS = 7  # 35 bits, more than any image's pixels


def read_runs(segmentation: JsonNode, width: int, height: int) -> Runs:
    """The lengths of the runs of a ``{"size": [h, w], "counts": ...}`` value.

    Raises:
        InputError: if it is not such a value, its size is not `width` x `height`,
            or its runs do not add up to that size.
    """
    size = segmentation["size"]
    if size.array(2).tolist() != [height, width]:
        size.fail(
            f"is {size.value}, but the image has [{height}, {width}]",
            "segmentations must have the size of the image",
        )
    counts = segmentation["counts"]
    if isinstance(counts.value, str):
        runs = _unpack(counts)
    else:
        runs = np.array(
            [run.integer(0, width * height) for run in counts.elements()], np.int64
        )
    # Single runs first: the sum of impossible ones may wrap around.
    if ((runs < 0) | (runs > width * height)).any():
        counts.fail(
            f"holds a run that does not fit into {width * height} pixels",
            "encode the mask again, column by column",
        )
    if runs.sum() != width * height:
        counts.fail(
            f"sums to {runs.sum()} pixels, but the mask has {width * height}",
            "encode the mask again, column by column",
        )
    return runs


def decode_runs(runs: Runs, width: int, height: int) -> Mask:
    """The mask (height, width) with alternating runs of false and true."""
    values = np.arange(len(runs)) % 2 == 1
    return np.ascontiguousarray(np.repeat(values, runs).reshape(width, height).T)


def _unpack(counts: JsonNode) -> Runs:
    """Runs of a compressed string; each may still be negative or too long."""
    text = counts.value.encode("utf-8", "surrogatepass")
    codes = np.frombuffer(text, np.uint8).astype(np.int64) - 48
    if ((codes < 0) | (codes > 63)).any():
        counts.fail("holds a character outside '0'..'o'", "encode the mask again")
    last = np.flatnonzero(codes < 32)
    if len(codes) == 0 or codes[-1] >= 32:
        counts.fail("ends within a run", "encode the mask again")
    first = np.concatenate([[0], last[:-1] + 1])
    if (last - first >= _MAX_GROUPS).any():
        counts.fail("holds a run that is too long", "encode the mask again")
    place = np.arange(len(codes)) - np.repeat(first, last - first + 1)
    values = np.add.reduceat((codes & 31) << (5 * place), first)
    # The top bit of the last group is the sign.
    values -= np.where(codes[last] & 16, 1 << (5 * (last - first + 1)), 0)
    for parity in (1, 2):
        values[parity::2] = np.cumsum(values[parity::2])
    return values
