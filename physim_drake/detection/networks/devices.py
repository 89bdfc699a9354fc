# SPDX-License-Identifier: MIT
"""Where networks run, and how precisely.

On import order: torch, pydrake, Open3D and CoACD each bring their own runtimes. Of
their 24 orders, exactly those fail in which CoACD comes first, because it then breaks
pydrake's casts. `objects/convex_pieces.py` therefore imports it late. torch may be
imported at any time. (torch 2.13, pydrake 1.51, Open3D 0.19, CoACD 1.0.14.)
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path

import torch

from physim_drake.detection.networks.device_name import DeviceName as DeviceName
from physim_drake.errors import InputError

_CPU_FACTS = Path("/proc/cpuinfo")


def choose_device(name: DeviceName = DeviceName.AUTO) -> torch.device:
    """The device of this name, or the best there is.

    Raises:
        InputError: if this machine does not have such a device.
    """
    there = {
        DeviceName.CUDA: torch.cuda.is_available(),
        DeviceName.MPS: torch.backends.mps.is_available(),
        DeviceName.CPU: True,
    }
    if name is DeviceName.AUTO:
        return torch.device(next(str(kind) for kind, found in there.items() if found))
    if not there[name]:
        raise InputError("--device", f"is {name}, which is not here", "give cpu")
    return torch.device(str(name))


def has_fast_bfloat16(device: torch.device) -> bool:
    """Whether a device multiplies numbers of 16 bits faster than those of 32.

    CPUs with tile instructions (AMX) are six times as fast. On others the conversions
    cost what is gained.
    """
    if device.type == "cuda":
        return bool(torch.cuda.is_bf16_supported())
    if device.type == "cpu" and _CPU_FACTS.exists():
        return "amx_bf16" in _CPU_FACTS.read_text(errors="replace")
    return False


def mixed_precision(
    device: torch.device, wanted: bool
) -> AbstractContextManager[object]:
    """Within it, convolutions and products use 16 bits if wanted."""
    return torch.autocast(device.type, torch.bfloat16, enabled=wanted)
