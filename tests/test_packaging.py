# SPDX-License-Identifier: MIT
"""Archives hold everything, and however it is installed there is one package."""

from __future__ import annotations

import ast
import itertools
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import venv
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import Distribution, packages_distributions, version
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

from physim_drake import __version__
from physim_drake.extras import EXTRAS

ROOT = Path(__file__).parents[1]
LINKED = ("models", "systems")
"""Folders at the top to which links in the package lead; an archive has no links."""

LEFT_OUT = {".gitignore"}

_BUILD = "import sys, setuptools.build_meta as b; b.build_{}(sys.argv[1])"


@dataclass(frozen=True)
class Built:
    """What was built of a copy of the working tree.

    Attributes:
        tracked: the files that git knows, relative to the root.
        copied: these, and those that it would know after `git add`.
        source: the copy, as a checkout.
        wheel: built of the copy.
        sdist: built of the copy.
        wheel_of_sdist: built of what `sdist` holds.
    """

    tracked: frozenset[str]
    copied: frozenset[str]
    source: Path
    wheel: Path
    sdist: Path
    wheel_of_sdist: Path


def build(what: str, source: Path, out: Path) -> Path:
    """Builds a wheel or an sdist of a folder, as pip does."""
    out.mkdir()
    command = [sys.executable, "-c", _BUILD.format(what), str(out)]
    done = subprocess.run(command, cwd=source, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (path,) = out.iterdir()
    return path


def listed(*options: str) -> frozenset[str]:
    """Files that git lists, those deleted apart."""
    done = subprocess.run(
        ["git", "ls-files", "-z", *options],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    names = done.stdout.split("\0")
    return frozenset(
        n for n in names if (ROOT / n).is_file() or (ROOT / n).is_symlink()
    )


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    folder = tmp_path_factory.mktemp("packaging")
    if not (ROOT / ".git").exists() or shutil.which("git") is None:
        pytest.skip("what belongs to the package is known from git, which is not here")
    tracked = listed()
    copied = tracked | listed("--others", "--exclude-standard")
    source = folder / "source"
    for name in copied:
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, source / name, follow_symlinks=False)
    sdist = build("sdist", source, folder / "sdist")
    with tarfile.open(sdist) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    (unpacked,) = (folder / "unpacked").iterdir()
    return Built(
        tracked,
        copied,
        source,
        build("wheel", source, folder / "wheel"),
        sdist,
        build("wheel", unpacked, folder / "again"),
    )


def packed(names: frozenset[str]) -> set[str]:
    """Where files of the repository stand in an archive, links replaced by files."""
    links = {f"physim_drake/{folder}" for folder in LINKED}
    linked = tuple(f"{folder}/" for folder in LINKED)
    return {f"physim_drake/{n}" if n.startswith(linked) else n for n in names - links}


def files_in(wheel: Path) -> dict[str, int]:
    """The names of its files, each with a checksum."""
    with zipfile.ZipFile(wheel) as archive:
        return {info.filename: info.CRC for info in archive.infolist()}


def test_the_wheel_holds_every_file_of_the_packages(built: Built) -> None:
    expected = {n for n in packed(built.copied) if n.startswith("physim_drake/")}
    assert "physim_drake/py.typed" in expected
    assert "physim_drake/models/apc11/library.yaml" in expected
    found = set(files_in(built.wheel))
    assert expected - found == set()
    assert {n for n in found - expected if ".dist-info/" not in n} == set()


def test_the_source_archive_holds_every_tracked_file(built: Built) -> None:
    with tarfile.open(built.sdist) as archive:
        found = {
            member.name.partition("/")[2]
            for member in archive.getmembers()
            if member.isfile()
        }
    assert packed(built.tracked) - found - LEFT_OUT == set()
    added = {n for n in found - packed(built.copied) if ".egg-info/" not in n}
    assert added == {"PKG-INFO", "setup.cfg"}


def test_the_source_archive_builds_the_same_wheel(built: Built) -> None:
    """So that what holds for an installation of the one holds for the other."""
    assert files_in(built.wheel_of_sdist) == files_in(built.wheel)


@pytest.fixture(scope="module")
def environment(built: Built, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A new environment with the wheel."""
    return installed(built.wheel, tmp_path_factory.mktemp("environment"))


@pytest.fixture(scope="module")
def editable(built: Built, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A new environment with an editable installation of the copy."""
    folder = tmp_path_factory.mktemp("editable")
    wheel = build("editable", built.source, folder / "wheel")
    return installed(wheel, folder / "environment")


def installed(wheel: Path, folder: Path) -> Path:
    """A new environment with a wheel; its dependencies are those of the tests."""
    venv.create(folder, with_pip=False, symlinks=True)
    pip = [sys.executable, "-m", "pip", "--python", folder / "bin" / "python"]
    offline = ["--quiet", "--no-deps", "--no-index", "--disable-pip-version-check"]
    install = [*pip, "install", *offline, wheel]
    subprocess.run(install, check=True, env=clean_variables())
    (packages,) = (folder / "lib").glob("python*/site-packages")
    # A .pth file in a folder that another one names is not read, so that the
    # editable installation of the tests stays out of sight.
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder


def clean_variables() -> dict[str, str]:
    """The environment variables, without a path to other packages."""
    return {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}


def run(
    environment: Path, *command: str, cwd: Path | None = None, **variables: str
) -> str:
    """What a program of the environment prints; it must succeed."""
    done = subprocess.run(
        [environment / "bin" / command[0], *command[1:]],
        cwd=cwd or environment,
        env=clean_variables() | variables,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_installed_program_knows_its_commands(environment: Path) -> None:
    text = run(environment, "physim-drake", "--help")
    for name in ("estimate", "evaluate", "report", "explain", "doctor", "models"):
        assert f" {name} " in text
    assert run(environment, "physim-drake", "--version").split()[1] == __version__


def test_the_installed_program_completes_its_commands(environment: Path) -> None:
    answer = run(
        environment,
        "physim-drake",
        _PHYSIM_DRAKE_COMPLETE="complete_bash",
        COMP_WORDS="physim-drake ex",
        COMP_CWORD="1",
    )
    assert answer.split() == ["explain"]


def test_the_installed_package_finds_nothing_wrong(environment: Path) -> None:
    report = json.loads(run(environment, "physim-drake", "doctor", "--json"))
    assert report["ok"]
    messages = {check["name"]: check["message"] for check in report["checks"]}
    assert messages["models"].startswith("11 objects")
    assert str(environment) in messages["compiled loops"]


def test_the_installed_models_can_be_loaded(environment: Path) -> None:
    program = """
import physim_drake
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from physim_drake.models import APC11, PACKAGE_XML, SDA10F
from physim_drake.objects.model import ObjectLibrary

plant = MultibodyPlant(0.01)
parser = Parser(plant)
parser.package_map().AddPackageXml(PACKAGE_XML)
parser.AddModels(SDA10F / "motoman_sda10f.urdf")
for model in ObjectLibrary.load(APC11).values():
    parser.AddModels(APC11 / model.name / f"{model.name}.sdf")
plant.Finalize()
print(plant.num_model_instances() - 2, physim_drake.__file__)
"""
    count, path = run(environment, "python", "-c", program).split()
    assert count == "12"
    assert Path(path).is_relative_to(environment)


_FOLDERS = """
from pathlib import Path

import physim_drake
import physim_drake.models
import physim_drake.systems

modules = (physim_drake, physim_drake.models, physim_drake.systems)
folders = [Path(module.__file__).parent for module in modules]
"""


def test_a_wheel_is_one_package(environment: Path) -> None:
    package, models, systems = imported_folders(environment)
    assert package.is_relative_to(environment)
    assert (models, systems) == (package / "models", package / "systems")


def test_an_editable_installation_is_the_checkout(built: Built, editable: Path) -> None:
    package, models, systems = imported_folders(editable)
    assert package == built.source / "physim_drake"
    assert (models, systems) == (package / "models", package / "systems")


@pytest.mark.parametrize("installation", ["environment", "editable"])
def test_pytest_in_the_checkout_tests_the_checkout_alone(
    installation: str, built: Built, request: pytest.FixtureRequest
) -> None:
    """A checkout hides what is installed, so nothing may be missing from it."""
    package = built.source / "physim_drake"
    expected = [str(package / part) for part in ("", "models", "systems")]
    (built.source / "tests" / "test_of_folders.py").write_text(
        f"{_FOLDERS}\n\ndef test_folders() -> None:\n"
        f"    assert list(map(str, folders)) == {expected}\n"
    )
    # Without -P, the current folder would be on the path, which pytest has not.
    pytest_alone = ("python", "-P", "-m", "pytest", "-p", "no:cacheprovider")
    environment = request.getfixturevalue(installation)
    run(environment, *pytest_alone, "tests/test_of_folders.py", cwd=built.source)


def imported_folders(environment: Path) -> list[Path]:
    """Where the package, its models and its systems are imported from."""
    program = f"{_FOLDERS}\nprint(*folders, sep='\\n')"
    return [Path(p) for p in run(environment, "python", "-c", program).splitlines()]


def test_the_citation_is_of_this_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert citation["version"] == project["version"] == __version__
    assert citation["license"] == project["license"]
    assert citation["authors"] == project["authors"]
    (paper,) = citation["references"]
    assert paper["title"] in " ".join((ROOT / "README.md").read_text().split())


def declared(project: Distribution, extras: Iterable[str] = ("",)) -> list[Requirement]:
    """What the metadata of a distribution asks for, alone or with extras."""
    asked = map(Requirement, project.requires or [])
    return [
        r
        for r in asked
        if r.marker is None or any(r.marker.evaluate({"extra": e}) for e in extras)
    ]


def test_the_dependencies_of_the_wheel_are_those_that_are_tested(
    environment: Path,
) -> None:
    """So that what pip brings beside the wheel is what all other tests ran with."""
    (info,) = environment.glob("lib/*/site-packages/physim_drake-*.dist-info")
    asked = declared(Distribution.at(info), ("", *EXTRAS))
    assert len(asked) > 15
    for requirement in asked:
        assert version(requirement.name) in requirement.specifier, requirement


def test_whatever_the_packages_import_is_declared() -> None:
    """An import of something that others bring breaks when they stop doing so."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    texts = [
        *project["dependencies"],
        *itertools.chain.from_iterable(
            project["optional-dependencies"][e] for e in EXTRAS
        ),
    ]
    names = {Requirement(text).name.lower() for text in texts}
    brought = packages_distributions()
    folders = [ROOT / folder for folder in ("physim_drake", *LINKED)]
    for path in itertools.chain.from_iterable(f.rglob("*.py") for f in folders):
        # pytest_plugin.py is imported by pytest alone.
        known = {"physim_drake", "pytest"} | sys.stdlib_module_names
        for module in imported(path) - known:
            distributions = {name.lower() for name in brought.get(module, [])}
            assert distributions & names, f"{path.name}: {module}"


def imported(path: Path) -> set[str]:
    """The first parts of the names of all modules that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            found.add(node.module.partition(".")[0])
    return found
