# SPDX-License-Identifier: MIT
"""What the documents say works: every code block is run, or says why it is not."""

from __future__ import annotations

import importlib.util
import json
import pkgutil
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import typer
import yaml

from physim_drake.cli import app
from physim_drake.datasets.results import read_results
from physim_drake.errors import PhysimError
from physim_drake.estimation.estimator import EstimationConfig, Method, estimate_scene
from physim_drake.models import APC11
from physim_drake.picking.scenario import PickScenario
from physim_drake.storage.typed_yaml import parse_typed_yaml
from tests.documents import (
    EXAMPLE,
    PAGES,
    ROOT,
    SHORTER,
    TESTED_ELSEWHERE,
    all_blocks,
    blocks,
    commands,
    lay_out,
    not_run,
    parse,
    run,
)

DOCS = ROOT / "docs"
FIRST_IMAGE = DOCS / "first-image.md"
"""Its steps build on each other: a test of its own takes them all."""

SHELL_PAGES = [page for page in PAGES if blocks(page, "sh")]
MESHES = {
    "crayons": "crayola_24_ct",
    "tissues": "kleenex_tissue_box",
    "bottle": "up_glucose_bottle",
}
"""Which models stand for those of the documents."""

LANGUAGES = {"", "json", "python", "sh", "yaml"}
PROGRAMS = ("physim-drake", ".venv/bin/physim-drake")

GET_THE_SOURCES = (
    ["git", "clone", "REPOSITORY", "physim-drake"],
    ["cd", "physim-drake"],
)
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]

MOST_NOT_RUN = 8
"""Blocks that the tests do not run, each of which takes long."""


def ident(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.fixture
def desk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[str, str, dict[str, Any]], None]:
    """A current folder with what the documents take to be there; runs Python in it."""
    lay_out(tmp_path)
    monkeypatch.chdir(tmp_path)
    quick = EstimationConfig(Method.PCA_ICP)
    monkeypatch.setattr(estimate_scene, "__defaults__", (quick, None))

    def run_python(text: str, name: str, namespace: dict[str, Any]) -> None:
        exec(compile(text, name, "exec"), namespace)

    return run_python


def test_the_programs_of_readme_and_first_steps_run(
    desk: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    namespace: dict[str, Any] = {}
    for page in (ROOT / "README.md", DOCS / "getting-started.md"):
        code = blocks(page, "python")
        assert code, f"{page.name} shows no Python"
        for text in code:
            desk(text, page.name, namespace)
    assert "up_glucose_bottle" in capsys.readouterr().out
    assert Path("overlay.png").is_file()


def test_the_integration_test_of_the_documents_passes() -> None:
    plugin, test = blocks(DOCS / "integration-tests.md", "python")
    namespace: dict[str, Any] = {}
    exec(compile(plugin, "conftest.py", "exec"), namespace)
    assert namespace["pytest_plugins"] == ["physim_drake.pytest_plugin"]
    exec(compile(test, "integration-tests.md", "exec"), {})


def test_the_program_for_data_of_ones_own_finds_the_objects(
    desk: Callable[..., None], tmp_path: Path
) -> None:
    page = DOCS / "estimate-your-own-data.md"
    (library,) = blocks(page, "yaml")
    models = tmp_path / "mymodels"
    models.mkdir()
    (models / "library.yaml").write_text(library)
    for mine, theirs in MESHES.items():
        mesh = APC11 / theirs / f"{theirs}.obj"
        (models / f"{mine}.obj").write_bytes(mesh.read_bytes())
    depth = EXAMPLE / "test" / "000001" / "depth" / "000000.png"
    (tmp_path / "depth.png").write_bytes(depth.read_bytes())
    (program,) = blocks(page, "python")
    namespace: dict[str, Any] = {}
    desk(program, page.name, namespace)
    found = {item.name: item.X_CO for item in namespace["estimate"].objects}
    truth = json.loads((depth.parents[1] / "scene_gt.json").read_text())["0"]
    centre = {t["obj_id"]: np.array(t["cam_t_m2c"]) / 1000 for t in truth}
    for name, object_id in (("crayons", 1), ("tissues", 8), ("bottle", 5)):
        off = found[name][:3, 3] - centre[object_id]
        assert np.linalg.norm(off) < 0.02, name


def test_the_steps_of_the_first_image_lead_to_poses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (program,) = blocks(FIRST_IMAGE, "python")
    exec(compile(program, FIRST_IMAGE.name, "exec"), {})
    (library,) = blocks(FIRST_IMAGE, "yaml")
    (tmp_path / "mymodels" / "library.yaml").write_text(library)
    steps = [c[1:] for b in blocks(FIRST_IMAGE, "sh") for c in commands(b)]
    steps = [words for words in steps if words[0] not in ("setup", *TESTED_ELSEWHERE)]
    assert [words[0] for words in steps] == ["models", "generate", "estimate"]
    command = typer.main.get_command(app)
    for words in steps[:2]:
        command.main(words, standalone_mode=False)
    shown, own = (tmp_path / name / "test" / "000001" for name in ("camera", "mydata"))
    for name in ("depth", "rgb"):
        (own / name).mkdir(parents=True)
        (own / name / "000000.png").write_bytes(
            (shown / name / "000000.png").read_bytes()
        )
    camera, targets, detections = blocks(FIRST_IMAGE, "json")
    (own / "scene_camera.json").write_text(camera)
    (own.parents[1] / "test_targets_bop19.json").write_text(targets)
    (own.parents[1] / "detections.json").write_text(detections)
    command.main([*steps[2], "--workers", "1"], standalone_mode=False)
    truth = json.loads((shown / "scene_gt.json").read_text())["0"]
    centre = {t["obj_id"]: np.array(t["cam_t_m2c"]) / 1000 for t in truth}
    rows = read_results(tmp_path / "results.csv")
    assert sorted(row.object_id for row in rows) == [1, 2]
    for row in rows:
        assert row.score > 0.8
        assert np.linalg.norm(row.X_CO[:3, 3] - centre[row.object_id]) < 0.005
    assert (tmp_path / "overlays" / "000001_000000.png").is_file()


def test_the_cell_of_the_documents_can_work(
    desk: Callable[..., None], tmp_path: Path
) -> None:
    page = DOCS / "your-own-cell.md"
    cell, scenario, planner = blocks(page, "yaml")
    for text in (cell, scenario):
        name = text.splitlines()[0].removeprefix("# ")
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    (check,) = blocks(page, "python")
    namespace: dict[str, Any] = {}
    desk(check, page.name, namespace)
    assert namespace["cell"].geometry.X_WA[2, 3] == pytest.approx(0.70)
    (tmp_path / "cell" / "cell.dmd.yaml").write_text(cell.replace("0.64", "1.64"))
    with pytest.raises(PhysimError, match="reach"):
        desk(check, page.name, {})
    shown = yaml.safe_load(planner)["planner"]
    example = (ROOT / "examples" / "another_robot.py").read_text()
    for key, value in shown.items():
        assert yaml.safe_load(re.search(rf"{key}: (.*)", example)[1]) == value  # type: ignore[index]


def test_every_python_block_is_in_a_tested_page() -> None:
    tested = {
        "README.md",
        "build-a-diagram.md",  # in tests/systems
        "estimate-your-own-data.md",
        "first-image.md",
        "getting-started.md",
        "integration-tests.md",
        "your-own-cell.md",
    }
    assert {page.name for page in PAGES if blocks(page, "python")} == tested


def test_json_of_the_documents_is_json() -> None:
    texts = [text for page in PAGES for text in blocks(page, "json")]
    assert len(texts) == 6
    for text in texts:
        assert json.loads(text)


def test_the_scenario_of_the_documents_is_one() -> None:
    (text,) = blocks(DOCS / "pick-cell.md", "yaml")
    scenario = parse_typed_yaml(text, PickScenario)
    assert scenario.look.views[0].azimuth_deg == 180


def test_every_yaml_block_is_in_a_tested_page() -> None:
    tested = {
        "build-a-diagram.md",
        "estimate-your-own-data.md",
        "first-image.md",
        "pick-cell.md",
        "your-own-cell.md",
    }
    assert {page.name for page in PAGES if blocks(page, "yaml")} == tested


@pytest.mark.parametrize("page", SHELL_PAGES, ids=ident)
def test_shell_blocks_run(
    page: Path, desk: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    for block in blocks(page, "sh"):
        for program, *words in commands(block):
            if program in PROGRAMS:
                parse(words)
                elsewhere = page == FIRST_IMAGE or words[0] in TESTED_ELSEWHERE
                if not_run(block) is None and not elsewhere:
                    run(words)
            else:
                assert_is_there(program, words)


def assert_is_there(program: str, words: list[str]) -> None:
    """Of what the tests run without the documents: its file or target exists."""
    if program == "make":
        targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M)
        assert {word for word in words if "=" not in word} <= set(targets)
    elif program == "pip":
        extras = re.fullmatch(r"install \.(?:\[([a-z,]+)\])?", " ".join(words))
        assert extras, words
        assert {*(extras[1] or "all").split(",")} <= {*PROJECT["optional-dependencies"]}
    elif program in ("mypy", "pytest", "python", "ruff"):
        paths = [word for word in words if word[0] != "-" and "/" in word]
        assert all((ROOT / path).exists() for path in paths), paths
    else:
        assert [program, *words] in GET_THE_SOURCES, "no test knows this program"


def test_a_block_that_is_not_run_says_why() -> None:
    reasons = {
        ident(page): [r for b in blocks(page, "sh") if (r := not_run(b))]
        for page in SHELL_PAGES
    }
    assert 0 < sum(map(len, reasons.values())) <= MOST_NOT_RUN, reasons


@pytest.mark.parametrize("page", PAGES, ids=ident)
def test_code_blocks_say_their_language(page: Path) -> None:
    for language, text in all_blocks(page):
        assert language in LANGUAGES
        if language == "":
            assert not re.search(
                r"^(\.venv/bin/)?(physim-drake|make|pip|pytest) ", text
            )


def test_what_a_block_may_not_say_is_refused() -> None:
    parse(["estimate", "DATASET", "--out", "results.csv", "--method", "pca-icp"])
    parse(["models", "check", "DIR"])
    for wrong in (
        ["estimate", "DATASET"],
        ["estimate", "DATASET", "--out", "r.csv", "--metod", "pca-icp"],
        ["estimate", "DATASET", "--out", "r.csv", "--method", "METHOD"],
        ["models", "chekc", "DIR"],
        ["estimaet", "DATASET"],
    ):
        with pytest.raises(Exception, match=r"Missing|No such|not one of|Did you"):
            parse(wrong)


@pytest.mark.parametrize("page", PAGES, ids=ident)
def test_links_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text())
    for link in links:
        if not link.startswith("https://"):
            assert (page.parent / link).exists(), link


def test_what_has_moved_is_where_the_changelog_says() -> None:
    changes = (ROOT / "CHANGELOG.md").read_text()
    table = changes.partition("| old path | new path |")[2].partition("\n### ")[0]
    rows = re.findall(r"^\| `physim_drake.* \| (.*) \|$", table, re.MULTILINE)
    assert len(rows) > 20
    for row in rows:
        package = ""
        for name in re.findall(r"`([\w.]+)`", row):
            path = name if name.startswith("physim_drake.") else f"{package}.{name}"
            package = path.rpartition(".")[0]
            assert importlib.util.find_spec(path), path


def test_what_is_renamed_has_the_name_that_the_changelog_says() -> None:
    table = (ROOT / "CHANGELOG.md").read_text().partition("| old name | new name |")[2]
    rows = re.findall(r"^\| `(physim_drake.*)` \| (.*) \|$", table, re.MULTILINE)
    assert len(rows) > 20
    for old, new in rows:
        for path in re.findall(r"`(physim_drake[\w.]+)", new):
            pkgutil.resolve_name(path)
        if old.endswith("MctsPoseEstimator"):
            pkgutil.resolve_name(old)
        elif "(" not in old:
            with pytest.raises((AttributeError, ImportError)):
                pkgutil.resolve_name(old)


def names() -> list[str]:
    return sorted(typer.main.get_command(app).commands)  # type: ignore[attr-defined]


CLI_PAGE = (DOCS / "cli.md").read_text()


def option_tables() -> ModuleType:
    """The program that writes the tables of docs/cli.md."""
    path = DOCS / "write_option_tables.py"
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_tables_of_options_are_those_of_the_commands() -> None:
    current = option_tables().rewritten(CLI_PAGE)
    assert current == CLI_PAGE, "run `python docs/write_option_tables.py`"


def test_every_command_has_a_section_with_its_options() -> None:
    for name in option_tables().commands():
        section = CLI_PAGE.partition(f"\n## {name}\n")[2].partition("\n## ")[0]
        assert f"<!-- options of {name} -->" in section
        assert f"| [`{name}" in CLI_PAGE.partition("\n## ")[0]


def test_the_tables_show_what_the_help_shows() -> None:
    found = option_tables().commands()
    for name, command in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
        if name not in found:  # a group
            continue
        section = CLI_PAGE.partition(f"\n## {name}\n")[2].partition("\n## ")[0]
        described = set(re.findall(r"(?<=`)--[a-z-]+(?=[ `])", section))
        options = {o for p in command.params for o in (*p.opts, *p.secondary_opts)}
        shared = {"--help", "--quiet", "--log-level"}
        assert {o for o in options if o.startswith("--")} - shared <= described, name


def test_options_that_commands_share_are_described() -> None:
    section = CLI_PAGE.partition("\n## What they share\n")[2].partition("\n## ")[0]
    described = set(re.findall(r"^\| `(--[a-z-]+)", section, re.MULTILINE))
    assert described == {"--quiet", "--log-level"}


def test_every_command_is_run_or_said_not_to_be() -> None:
    assert set(SHORTER) | set(TESTED_ELSEWHERE) <= set(names())
