# SPDX-License-Identifier: MIT
"""Checks whether this installation works, and says how to repair it.

Nothing heavy is imported here. What may crash (OpenGL, Drake, torch) is tried by
`physim_drake.doctor.probes` in a separate process, so that a library that crashes its
process is a failing check like any other.
"""

from __future__ import annotations

import json
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path

from physim_drake.doctor.system_libraries import INSTALL, library_remedy
from physim_drake.parallel.cores import core_count

LEAST_PYTHON = (3, 11)
LEAST_MEMORY = 2.0
"""Memory below which an estimate with two workers is likely to be killed, GiB."""
LEAST_DISK = 0.5
"""Disk space for what is compiled, cached and written, GiB."""
_TIMEOUT = 240.0  # s; the first run compiles
_GIB = 2.0**30


class Status(StrEnum):
    """The outcome of a check."""

    OK = "ok"
    WARNING = "warning"
    FAIL = "FAIL"


@dataclass(frozen=True)
class Check:
    """The result of one check.

    Attributes:
        name: name of the check.
        status: outcome.
        message: finding, in one line.
        remedy: advice; empty if nothing needs to be done.
    """

    name: str
    status: Status
    message: str
    remedy: str = ""

    def as_dict(self) -> dict[str, str]:
        """Plain strings, for JSON."""
        return asdict(self) | {"status": str(self.status)}

    @classmethod
    def from_dict(cls, values: dict[str, str]) -> Check:
        """Reads what `as_dict` gives."""
        return cls(
            values["name"],
            Status(values["status"]),
            values["message"],
            values["remedy"],
        )


@dataclass(frozen=True)
class Probe:
    """A check that runs in a separate process.

    Attributes:
        name: name of the check in `physim_drake.doctor.probes`.
        remedy: advice if the process crashes or hangs.
    """

    name: str
    remedy: str


_REINSTALL = "pip install --force-reinstall physim-drake"

PROBES = (
    Probe("packages", _REINSTALL),
    Probe("extras", _REINSTALL),
    Probe("rendering", INSTALL),
    Probe("physics", "pip install --force-reinstall drake"),
    Probe("compiled loops", "set NUMBA_CACHE_DIR to a folder that you may write"),
    Probe("worker processes", "use --workers 1"),
    Probe("models", _REINSTALL),
    Probe("torch", "pip install --force-reinstall torch"),
    Probe("detector weights", _REINSTALL),
)


def check_installation() -> Iterator[Check]:
    """Runs every check, and yields each as soon as those before it are done."""
    for check in _QUICK:
        yield check()
    with ThreadPoolExecutor(max_workers=min(4, max(1, core_count()))) as pool:
        yield from pool.map(run_probe, PROBES)


def run_probe(probe: Probe, timeout: float = _TIMEOUT) -> Check:
    """Runs a check in a new interpreter; a crash or hang gives a failed `Check`."""
    # -P: a folder physim_drake in the working directory is not the installed one.
    module = "physim_drake.doctor.probes"
    command = [sys.executable, "-P", "-m", module, probe.name]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            timeout=timeout,
            text=True,
            errors="replace",
            check=False,
        )
    except subprocess.TimeoutExpired:
        message = f"no result within {timeout:.0f} s"
        return Check(probe.name, Status.FAIL, message, probe.remedy)
    lines = done.stdout.splitlines()
    if done.returncode == 0 and lines:
        return Check.from_dict(json.loads(lines[-1]))
    remedy = library_remedy(done.stderr) or probe.remedy
    return Check(probe.name, Status.FAIL, _how_it_ended(done), remedy)


def _how_it_ended(done: subprocess.CompletedProcess[str]) -> str:
    said = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    last = said[-1] if said else f"exit status {done.returncode}, without a message"
    if done.returncode < 0:
        return f"ended by {_signal_name(-done.returncode)}: {last}"
    return last


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _python() -> Check:
    version = platform.python_version()
    found = f"{version} on {platform.system()} {platform.machine()}"
    if sys.version_info < LEAST_PYTHON:
        least = ".".join(map(str, LEAST_PYTHON))
        remedy = f"make an environment with Python {least} or later"
        return Check("python", Status.FAIL, f"{found} is too old", remedy)
    if platform.system() != "Linux":
        return Check(
            "python",
            Status.WARNING,
            f"{found}: only Linux is tested",
            "if something fails, use Linux, or a container with it",
        )
    return Check("python", Status.OK, found)


def _cores() -> Check:
    count = core_count()
    if count == 1:
        return Check(
            "cores",
            Status.WARNING,
            "1, so that an image takes several times as long",
            "let this process use more cores",
        )
    return Check("cores", Status.OK, str(count))


def _memory() -> Check:
    free = available_memory()
    if free is None:
        return Check("memory", Status.OK, "not known on this system")
    found = f"{free:.1f} GiB available"
    if free < LEAST_MEMORY:
        return Check(
            "memory",
            Status.WARNING,
            found,
            "close other programs, or use --workers 1: each worker takes 0.6 GiB",
        )
    return Check("memory", Status.OK, found)


def available_memory(
    meminfo: Path = Path("/proc/meminfo"), cgroup: Path = Path("/sys/fs/cgroup")
) -> float | None:
    """Memory that is available within a container's limit, GiB; None if not known.

    Args:
        meminfo: file of the kernel's figures.
        cgroup: folder of this process's control group (version 2).
    """
    try:
        lines = meminfo.read_text().splitlines()
        kib = next(int(x.split()[1]) for x in lines if x.startswith("MemAvailable:"))
    except (OSError, StopIteration):
        return None
    free = kib / 2.0**20
    try:
        limit = int((cgroup / "memory.max").read_text())
        used = int((cgroup / "memory.current").read_text())
    except (OSError, ValueError):  # no limit reads "max"
        return free
    return min(free, (limit - used) / _GIB)


def _disk() -> Check:
    folders = {"temporary files": Path(tempfile.gettempdir()), "here": Path.cwd()}
    free = {
        what: shutil.disk_usage(folder).free / _GIB for what, folder in folders.items()
    }
    found = ", ".join(f"{gib:.1f} GiB for {what}" for what, gib in free.items())
    found = found.replace("for here", "free in this folder")
    if min(free.values()) < LEAST_DISK:
        remedy = "free some space, or set TMPDIR to a folder with more"
        return Check("disk", Status.WARNING, found, remedy)
    return Check("disk", Status.OK, found)


_QUICK: Sequence[Callable[[], Check]] = (_python, _cores, _memory, _disk)
CHECKS = len(_QUICK) + len(PROBES)
"""Number of checks."""
