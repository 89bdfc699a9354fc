# SPDX-License-Identifier: MIT
"""Processor cores, and how many worker processes they are good for."""

from __future__ import annotations

import os

MAX_DEFAULT_WORKERS = 4
"""The search scores four placements at a time, so that more workers would idle."""


def core_count() -> int:
    """Number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def default_workers() -> int:
    """One worker process for each core, at most `MAX_DEFAULT_WORKERS`."""
    return min(core_count(), MAX_DEFAULT_WORKERS)
