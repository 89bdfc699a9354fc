# SPDX-License-Identifier: MIT
"""Checks that may crash: each runs in a separate process and prints a JSON line.

python -m physim_drake.doctor.probes NAME

A probe does a small piece of the library's real work, and raises if it fails.
`physim_drake.doctor.checks` runs the probes.
"""

from __future__ import annotations

import ctypes
import importlib
import importlib.metadata
import json
import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physim_drake.doctor.checks import Check, Status
from physim_drake.errors import InputError
from physim_drake.extras import EXTRAS, install_command, need_extra

if TYPE_CHECKING:
    from physim_drake.objects.model import ObjectModel

ProbeFunction = Callable[[], Check]

TESTED_DRAKE = ("1.51.1", "1.58.0")
"""Versions of Drake with which the tests have passed, the oldest first."""

_SIDE = 0.1  # m, of the boxes that are rendered and dropped
_HEIGHT = 0.6  # m, of the camera above the table
_GL_RENDERER = 0x1F01
_WORKER_TIMEOUT = 120.0  # s


def packages() -> Check:
    """Checks that the packages that the metadata requires are installed."""
    needed = _requirements()
    wrong = [problem for r in needed if (problem := _unmet(r))]
    if wrong:
        remedy = "pip install " + " ".join(f"'{r.name}{r.specifier}'" for r in needed)
        return Check("packages", Status.FAIL, ", ".join(wrong), remedy)
    drake = importlib.metadata.version("drake")
    found = f"all {len(needed)} needed; Drake {drake}"
    if drake not in TESTED_DRAKE:
        return Check(
            "packages",
            Status.WARNING,
            f"{found}, which was not tested; {' and '.join(TESTED_DRAKE)} were",
            f"if something fails, pip install drake=={TESTED_DRAKE[-1]}",
        )
    return Check("packages", Status.OK, found)


def extras() -> Check:
    """Lists the installed extras, and how to install the others; always OK."""
    there, absent = [], {}
    for name, extra in EXTRAS.items():
        problems = [problem for r in _requirements(name) if (problem := _unmet(r))]
        if problems:
            absent[name] = f"{name} for {extra.purpose} ({', '.join(problems)})"
        else:
            there.append(name)
    found = ", ".join(there) or "none"
    if absent:
        found += f"; not {', '.join(absent.values())}: {install_command(*absent)}"
    return Check("extras", Status.OK, found)


def _requirements(extra: str = "") -> list[Any]:
    """Requirements of the base, or those that an extra adds."""
    from packaging.requirements import Requirement

    def asked(requirement: Requirement, extra: str) -> bool:
        marker = requirement.marker
        return marker is None or marker.evaluate({"extra": extra})

    texts = importlib.metadata.requires("physim-drake") or ()
    listed = [Requirement(text) for text in texts]
    base = [r for r in listed if asked(r, "")]
    return [r for r in listed if asked(r, extra) and r not in base] if extra else base


def _unmet(requirement: Any) -> str:
    """The problem with one requirement; empty if it is met."""
    try:
        version = importlib.metadata.version(requirement.name)
    except importlib.metadata.PackageNotFoundError:
        return f"{requirement.name} is missing"
    if requirement.specifier.contains(version, prereleases=True):
        return ""
    return f"{requirement.name} is {version}, but {requirement.specifier} is needed"


def rendering() -> Check:
    """Renders a red box on a table, and checks its depth and colour."""
    import numpy as np

    from physim_drake.camera import CameraIntrinsics
    from physim_drake.objects.containers import ContainerName, load_container
    from physim_drake.poses import make_pose
    from physim_drake.rendering.appearance import Appearance
    from physim_drake.rendering.scene import SceneRenderer
    from physim_drake.storage.scratch import ScratchFolder

    start = time.monotonic()
    with ScratchFolder() as folder:
        visual = _write_red_box(folder.path)
        table = load_container(ContainerName.TABLE)
        renderer = SceneRenderer([visual], table, Appearance.plain())
    X_WC = make_pose(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, _HEIGHT]))
    X_WO = make_pose(p=np.array([0.0, 0.0, _SIDE / 2]))
    camera = CameraIntrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
    images = renderer.render(X_WO[None], X_WC, camera)
    taken = time.monotonic() - start
    depth, expected = float(images.depth[24, 32]), _HEIGHT - _SIDE
    if abs(depth - expected) > 0.001:
        raise RuntimeError(f"a box {expected} m away is rendered at {depth:.3f} m")
    red, green, blue = images.color[24, 32].tolist()
    if red < 2 * max(green, blue, 25):
        raise RuntimeError(f"a red box is rendered in RGB {red}, {green}, {blue}")
    return Check("rendering", Status.OK, f"by {_gl_renderer()}, ready in {taken:.1f} s")


def _write_red_box(folder: Path) -> Path:
    """Writes an OBJ file with its material; returns it."""
    text = _box().mesh.export(file_type="obj", include_normals=True)
    (folder / "box.mtl").write_text("newmtl red\nKd 1 0 0\n")
    path = folder / "box.obj"
    path.write_text(f"mtllib box.mtl\nusemtl red\n{text}")
    return path


def _gl_renderer() -> str:
    """Name of the renderer of the OpenGL context that is still current."""
    for name in ("libOpenGL.so.0", "libGL.so.1"):
        with suppress(OSError):
            library = ctypes.CDLL(name)
            library.glGetString.restype = ctypes.c_char_p
            text: bytes | None = library.glGetString(_GL_RENDERER)
            if text:
                return text.decode(errors="replace")
    return "a renderer that does not give its name"


def physics() -> Check:
    """Drops a box on a plane with hydroelastic contact, until it rests."""
    import numpy as np

    from physim_drake.physics.settling import Settler
    from physim_drake.poses import make_pose

    settler = Settler(_box(), [])
    start = time.monotonic()
    settled = settler.settle(make_pose(p=np.array([0.0, 0.0, _SIDE / 2 + 0.005])), {})
    taken = time.monotonic() - start
    height = float(settled.X_SO[2, 3]) - _SIDE / 2
    if settled.lost or not settled.at_rest or abs(height) > 0.001:
        raise RuntimeError(
            f"a box dropped on a table ends {1000 * height:.1f} mm above it, "
            f"{'at rest' if settled.at_rest else 'not at rest'}"
        )
    return Check("physics", Status.OK, f"a box settles in {1000 * taken:.0f} ms")


def _box() -> ObjectModel:
    import trimesh

    from physim_drake.objects.model import ObjectModel
    from physim_drake.poses import SymmetryGroup

    mesh = trimesh.creation.box((_SIDE, _SIDE, _SIDE))
    return ObjectModel.from_mesh(
        1, "box", mesh, symmetry=SymmetryGroup(), given_pieces=(mesh,)
    )


def compiled_loops() -> Check:
    """Checks that what numba compiles can be cached for the next run."""
    from physim_drake.registration.distance_field import lookup

    if lookup.stats.cache_path is None:
        return Check(
            "compiled loops",
            Status.WARNING,
            "not cached: every run compiles them for half a minute",
            "set NUMBA_CACHE_DIR to a folder that you may write",
        )
    folder = Path(lookup.stats.cache_path)
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        pass
    kept = sum(1 for _ in folder.glob("*.nbc"))
    done = (
        f"{kept} kept" if kept else "none yet: the first run takes half a minute more"
    )
    return Check("compiled loops", Status.OK, f"{done}, in {folder}")


def worker_processes() -> Check:
    """Starts two processes as an estimate does, and waits for their reply."""
    context = multiprocessing.get_context("spawn")
    start = time.monotonic()
    started = []
    for _ in range(2):
        ours, theirs = context.Pipe()
        process = context.Process(target=_report_in, args=(theirs,), daemon=True)
        process.start()
        theirs.close()
        started.append((process, ours))
    for process, link in started:
        if not link.poll(_WORKER_TIMEOUT):
            raise TimeoutError(f"a worker was silent for {_WORKER_TIMEOUT:.0f} s")
        try:
            word = link.recv()
        except EOFError:
            process.join()
            raise RuntimeError(
                f"a worker ended at once, exit status {process.exitcode}"
            ) from None
        if word != process.pid:
            raise RuntimeError(f"a worker cannot start: {word}")
        process.join()
    taken = time.monotonic() - start
    return Check("worker processes", Status.OK, f"two started in {taken:.1f} s")


def _report_in(link: Connection) -> None:
    """Imports what a worker needs, and sends the process id or an error."""
    try:
        importlib.import_module("physim_drake.estimation.workers")
    except Exception as error:
        link.send(f"{type(error).__name__}: {error}")
    else:
        link.send(os.getpid())


def models() -> Check:
    """Reads the object models and the robot that come with the package."""
    from pydrake.multibody.parsing import (
        LoadModelDirectives,
        Parser,
        ProcessModelDirectives,
    )
    from pydrake.multibody.plant import MultibodyPlant

    from physim_drake.models import APC11, PACKAGE_XML, SDA10F
    from physim_drake.objects.model import ObjectLibrary

    library = ObjectLibrary.load(APC11)
    problems = [f"{m.name}: {p}" for m in library.values() for p in m.problems]
    if problems:
        raise RuntimeError("; ".join(problems))
    plant = MultibodyPlant(0.01)
    parser = Parser(plant)
    parser.package_map().AddPackageXml(PACKAGE_XML)
    directives = LoadModelDirectives(SDA10F / "sda10f_with_tools.dmd.yaml")
    ProcessModelDirectives(directives, parser)
    plant.Finalize()
    joints = plant.num_actuated_dofs()
    found = f"{len(library)} objects, a robot with {joints} driven joints"
    return Check("models", Status.OK, found)


def torch_device() -> Check:
    """Runs a convolution on the device that a detector would use."""
    try:
        need_extra("train")
    except InputError as error:
        return _not_installed("torch", error)
    import torch

    from physim_drake.detection.networks.devices import choose_device

    device = choose_device()
    ones = torch.ones(1, 1, 8, 8, device=device)
    total = float(torch.nn.functional.conv2d(ones, ones[:, :, :3, :3]).sum())
    if total != 36 * 9:
        raise RuntimeError(f"a convolution on {device} gives {total}, not {36 * 9}")
    what = torch.cuda.get_device_name() if device.type == "cuda" else device.type
    return Check("torch", Status.OK, f"{torch.__version__} on {what}")


def detector_weights() -> Check:
    """Reads the weights that come with the package."""
    import physim_drake.models

    path = physim_drake.models.DETECTOR
    if not path.is_file():
        return Check(
            "detector weights",
            Status.WARNING,
            f"{path} does not exist, so images without boxes or masks cannot be "
            "estimated",
            "give --detections or --masks, or train weights with physim-drake train",
        )
    try:
        need_extra("train")
    except InputError as error:
        return _not_installed("detector weights", error)
    from physim_drake.detection.networks.weights import load_weights

    weights = load_weights(path)
    size = path.stat().st_size / 2**20
    found = f"for {len(weights.classes)} objects, {size:.1f} MiB"
    return Check("detector weights", Status.OK, found)


def _not_installed(name: str, error: InputError) -> Check:
    """A missing extra is not a failure; `extras` says how to install it."""
    return Check(name, Status.OK, f"not tried: {error.source} {error.problem}")


PROBE_FUNCTIONS: Mapping[str, ProbeFunction] = {
    "packages": packages,
    "extras": extras,
    "rendering": rendering,
    "physics": physics,
    "compiled loops": compiled_loops,
    "worker processes": worker_processes,
    "models": models,
    "torch": torch_device,
    "detector weights": detector_weights,
}


def main() -> None:
    """Runs the probe that the command line names, and prints its result."""
    # Numba, OpenGL or Drake may write to stdout; the last line is the result.
    check = PROBE_FUNCTIONS[sys.argv[1]]()
    print("\n" + json.dumps(check.as_dict()), flush=True)


if __name__ == "__main__":
    main()
