# SPDX-License-Identifier: MIT
"""What a base installation does, and what it says where an extra is missing."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from physim_drake.batch.detection_source import DetectionSource
from physim_drake.cli.detections import detection_source
from physim_drake.datasets.bop import BopDataset
from physim_drake.errors import InputError
from physim_drake.extras import EXTRAS, need_extra
from physim_drake.models import APC11
from physim_drake.parallel.ray_pool import RayPool
from physim_drake.systems.perception_config import NetworkDetectorConfig

ROOT = Path(__file__).parents[1]
SCENE = ROOT / "examples" / "data" / "tabletop"
BLOCKED = sorted({package for extra in EXTRAS.values() for package in extra.packages})

# Python imports a module of this name first of all, in child processes, too.
SITE = f"""
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {BLOCKED!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Blocked())
"""

IMPORT_ALL = """
import importlib, pkgutil, physim_drake
for module in pkgutil.walk_packages(physim_drake.__path__, "physim_drake."):
    if not module.name.startswith("physim_drake.models."):  # scripts
        try:
            importlib.import_module(module.name)
        except ModuleNotFoundError as error:
            print(module.name)
"""

MAIN = "from physim_drake.cli import main; main()"
RUN_ALL = """
import json, sys
from physim_drake.cli import app
for arguments in json.loads(sys.argv[1]):
    app(arguments, standalone_mode=False)
"""


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Variables under which Python does not find what only extras bring."""
    folder = tmp_path_factory.mktemp("base")
    (folder / "sitecustomize.py").write_text(SITE)
    return os.environ | {"PYTHONPATH": str(folder)}


def run(base: dict[str, str], *arguments: str | Path) -> tuple[int, str, str]:
    """Exit status, output and errors of Python in a base installation."""
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        env=base,
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr


def test_the_extras_are_those_of_the_metadata() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    optional = project["optional-dependencies"]
    for name, extra in EXTRAS.items():
        asked = {Requirement(text).name for text in optional[name]}
        assert asked == set(extra.packages)
    (everything,) = optional["all"]
    assert Requirement(everything).extras == set(EXTRAS)
    assert "physim-drake[all]" in optional["dev"]


def test_what_is_installed_is_needed_in_silence() -> None:
    need_extra("viz")


@pytest.mark.parametrize(
    ("extra", "package", "use"),
    [
        ("viz", "jinja2", lambda: need_extra("viz")),
        ("train", "torch", lambda: DetectionSource.network(BopDataset(SCENE))),
        ("train", "torch", lambda: NetworkDetectorConfig().make({}, {})),
        ("ray", "ray", lambda: RayPool(dict)),
    ],
)
def test_use_of_an_extra_that_is_missing_says_how_to_get_it(
    extra: str,
    package: str,
    use: Callable[[], object],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError) as caught:
        use()
    assert str(caught.value) == (
        f"{package}: is not installed (extra [{extra}]); "
        f"pip install 'physim-drake[{extra}]'"
    )


def test_without_boxes_an_estimate_names_the_extra_that_could_find_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    shutil.copytree(SCENE, tmp_path / "scene")
    (tmp_path / "scene" / "detections.json").unlink()
    with pytest.raises(InputError) as caught:
        detection_source(BopDataset(tmp_path / "scene"))
    assert "(extra [train])" in caught.value.problem
    assert "--detections" in caught.value.remedy


def test_only_what_is_of_an_extra_needs_one(base: dict[str, str]) -> None:
    status, printed, _ = run(base, "-c", IMPORT_ALL)
    assert status == 0
    names = printed.split()
    packages = {"detection", "reporting"}
    assert {name.split(".")[1] for name in names} == packages
    for name in ("detection.rivals", "detection.choosing", "reporting.study"):
        assert f"physim_drake.{name}" not in names


def test_a_base_installation_does_its_work(
    base: dict[str, str], tmp_path: Path
) -> None:
    triangles = "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    corners = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\n"
    (tmp_path / "wedge.obj").write_text(corners + triangles)
    results, pictures = tmp_path / "results.csv", tmp_path / "pictures"
    models = ("--models", APC11)
    quick = ("--method", "pca-icp", "--hypotheses", "1", "--workers", "1")
    commands = (
        ("models", "check", tmp_path),
        ("estimate", SCENE, "--out", results, "--overlays", pictures, *models, *quick),
        ("evaluate", results, SCENE, *models, "--no-vsd"),
    )
    listed = json.dumps([[str(word) for word in command] for command in commands])
    status, printed, said = run(base, "-c", RUN_ALL, listed)
    assert status == 0, said
    assert "wedge" in printed
    assert "5 deg" in printed  # of the table of errors
    assert (pictures / "000001_000000.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("extra", "arguments"),
    [
        ("train", ("train", "OUT")),
        ("train", ("detect", SCENE, "--out", "OUT")),
        ("train", ("learn", "OUT")),
        ("viz", ("report", SCENE, "--out", "OUT")),
        ("viz", ("explain", SCENE, "--image", "1/0", "--out", "OUT")),
        ("viz", ("pick", "scenario.yaml", "--record", "OUT")),
    ],
)
def test_what_needs_an_extra_says_so_in_one_line(
    extra: str, arguments: tuple[str | Path, ...], base: dict[str, str], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    words = [out if word == "OUT" else word for word in arguments]
    status, _, said = run(base, "-c", MAIN, *words)
    assert status == 2
    assert len(said.splitlines()) == 1
    assert said.startswith("error: ")
    assert f"is not installed (extra [{extra}])" in said
    assert said.endswith(f"pip install 'physim-drake[{extra}]'\n")
    assert not out.exists()


def test_help_and_the_installation_are_in_order(base: dict[str, str]) -> None:
    assert run(base, "-c", MAIN, "--help")[0] == 0
    probes = "physim_drake.doctor.probes"
    for name in ("torch", "detector weights"):
        status, printed, _ = run(base, "-m", probes, name)
        assert status == 0
        assert '"status": "ok"' in printed
        assert "not tried: torch is not installed (extra [train])" in printed
